"""Contour matching: drawn edges with predicted polarity, searched and fitted.

In: `LookModel` and `Target` with its contour, an image, `Artifact`, `Guess`. Out:
`Measurement` of position and angle, or `Failure`, to `routines.chain`.
The type that passes: `ScoredPose` (search).
May be touched here: search steps and scores, with a new version of `contour_match`.
Points are (N, 4): x, y and normal, px of the target's frame.
Watched by: tests/featuresel/routines/contour/test_match.py
"""
