"""Layers of different height: occlusion, coaxial light.

In: `Scene` with layers at several heights, `Microscope`, aperture of the lamp; blurred
layers (`Covered`) from optics.render. Out: images with occlusion and shade, the error
of blending without them, to featuresel.look, planner.looks and planner.tradeoff.
The type that passes: `Irradiance` (coaxial_light), `LayerSheet` (rays).
May be touched here: rays, lattices and steps, within `SHADED_ERROR` and the errors
that `layer_error` predicts.
Watched by: tests/optics/layers/test_occlusion.py and test_shading.py.
"""
