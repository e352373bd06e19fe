"""Maximum-likelihood pose fits: an image compared with the target's rendered planes.

In: `LookModel` and `Target` at preparation; images, `Artifact`, `Guess`. Out:
`Measurement` of position, angle, focus and zoom, or `Failure`, to `routines.chain`.
The type that passes: `ImageComparison` (comparison).
May be touched here: which pixels are compared and how a fit settles, with new versions
of `likelihood` and `one_step`. Keys of artifacts are in plan folders.
Watched by: tests/featuresel/routines/likelihood/test_pose_fit.py
"""
