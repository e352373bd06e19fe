"""Image routines."""
