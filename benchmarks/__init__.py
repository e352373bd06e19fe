"""Measured figures: speed, accuracy and success, by `python -m benchmarks`."""
