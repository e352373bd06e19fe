"""A driver for zoom, focus and jaws on a serial line: an example to copy."""
