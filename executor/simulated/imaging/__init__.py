"""Images of solid bodies: rays through prisms, diffraction near focus, sensor noise.

In: `SolidScene` (solids), `ImagingView` (imaging_view), a `PixelWindow`.
Out: `photograph(scene, view, window)` (photograph): share of full scale, a float array
(rows, columns); `counted` (electrons): what the converter makes of it.
The type that passes: `SolidScene`; inside, `SharpPlane`.
May be touched here: all of it, but never by what the compiler renders with: this camera
judges the compiler's images and shares neither code nor formulas with it.
Watched by: tests/executor/simulated/imaging/test_photograph.py.
"""
