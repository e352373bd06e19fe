"""Lens errors: distortion, field curvature, gradients, noise of the sensor.

In: `LensErrors` from planner.task, scenes of an ideal lens. Out: distorted scenes,
shifts of targets in nm, frames with noise, the image Jacobian, to featuresel and
planner.
The type that passes: `LensErrors` (lens), `LensRow` (lens_budget).
May be touched here: how errors are predicted; the signs of docs/conventions.md stay.
Watched by: tests/optics/lens/test_distorted_scene.py and test_lens_budget.py.
"""
