"""Focus measures: sharpness of an image, peak of a sweep, plan of a sweep.

In: images, (rows, columns) 0..1, and focus heights, um, from `executor.run`. Out:
`FocusPeak` or `Failure` to `executor.run`; `Sweep` of the cheapest stops.
The type that passes: `FocusPeak` (peak).
May be touched here: the measure and the fit, with the table of docs/focus.md; rivals
are in benchmarks/focus.
Watched by: tests/featuresel/routines/focus/test_peak.py
"""
