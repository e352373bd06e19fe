"""Solid bodies: rays that pass beside a top rim and meet the wall below it.

In: layers with an underside, walls that are black or mirrors; the light on faces from
optics.layers. Out: what walls change of an image and of the light, on lattices.
The type that passes: `ThickBody` (straight_rays), `SolidFace` (solid_bodies).
May be touched here: rays, lattices and steps, within what `test_solid_images.py` allows
against rays traced one by one.
Watched by: tests/optics/layers/solids/test_solid_images.py.
"""
