"""Circle routines: radial calipers, iso-line fits, Hough votes.

In: `LookModel` and `Target` from `routines.contract`, an image, `Artifact`, `Guess`.
Out: `Measurement` of a centre, px, or `Failure`, to `routines.chain`. The type that
passes: `FittedCircle` (circle_fit). May be touched here: thresholds of faint, cut-off
and scattered rims, with a new version of the routine that they change. Watched by:
tests/featuresel/routines/circle/test_iso_circle.py
"""
