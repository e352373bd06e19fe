"""Image formation of a microscope, from outlines to noise-free images.

In: dimensions and settings from planner.views and featuresel.look, as numbers.
Out: images, transfer functions and predicted errors, to featuresel and planner.
The type that passes: `Scene` (`microplan.optics.render.scene`).
May be touched here: anything that keeps `python -m benchmarks` within its bounds; no
files, clock, randomness or globals come in.
Watched by: tests/optics/test_oracle.py, the slow reference of every image.
"""
