"""Template routines: correlation, ECC, thresholds, phase correlation, keypoints.

In: `LookModel` and `Target`, an image, `Artifact`, `Guess`. Out: `Measurement` of
position and, where it is searched, angle, or `Failure`, to `routines.chain`.
The type that passes: `TemplateFit` (template_fit).
May be touched here: scores and search steps, with a new version of the routine.
`phase_correlation` and `keypoints` stay bad: they are controls.
Watched by: tests/featuresel/routines/template/test_ncc.py
"""
