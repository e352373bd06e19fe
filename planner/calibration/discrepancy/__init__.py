"""How far pictures of a known part differ from its images: edges, faces, pixels.

In: the part's light in pictures at several places, the compiler's images of it.
Out: the workcell's `discrepancy`, without noise, with standard deviations.
The type that passes: `PictureMisfit` (picture_misfit), `PlaceMisfits` (place_misfits).
May be touched here: statistics of residuals; what a discrepancy is belongs
to featuresel.
Watched by: tests/planner/calibration/discrepancy
"""
