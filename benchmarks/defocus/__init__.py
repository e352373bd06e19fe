"""Benchmarks of defocus models: bounds of what they cost in an image, and maps."""
