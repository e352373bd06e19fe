"""Mirror faces: what stands above them is seen again, black, below them.

In: layers above a face that mirrors. Out: their images, as blurred cover, as faces for
optics.layers.joint, as sheets for optics.layers.occlusion; scenes of what
dull faces send and of what mirrors do, where the lamp is narrower than the lens.
The type that passes: `Images` (images), `LitPart` (narrow_lamp).
May be touched here: how images are grouped by height; a dull face stays bit-equal.
Watched by: tests/optics/layers/mirrors/test_images.py and test_narrow_lamp.py.
"""
