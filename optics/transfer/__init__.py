"""Optical transfer functions (OTF) of a defocused circular pupil, by model.

In: `Microscope` and a defocus in um. Out: transfer over frequency, as a function or a
table, with bounds of each model's error, to optics.render and optics.layers.
The type that passes: `RadialTable` (`microplan.optics.transfer.models`).
May be touched here: quadrature, tables and their bounds, as long as `TABLE_ERROR` and
the extreme points hold; `microscope` follows the paper with errata and stays.
Watched by: tests/optics/transfer/test_otf.py, tests/optics/extremes.
"""
