"""Diffraction between bodies: waves of a sampled pupil, cut by face after face.

In: faces as rasters (`Probed`), the light on them, points of the image. Out: what waves
change of an image by rays, to optics.layers.layer_error.
The type that passes: `WaveLevel` (pupil_grid).
May be touched here: points of the grid and heights at which waves are held by place,
within what `test_face_waves.py` allows against waves of the tests.
Watched by: tests/optics/layers/diffraction/test_face_waves.py.
"""
