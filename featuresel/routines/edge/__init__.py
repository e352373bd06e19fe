"""Edge routines: straight calipers on edges, pairs, corners, jaws; phases of teeth.

In: `LookModel` and `Target`, an image, `Artifact`, `Guess`. Out:
`Measurement` of position and angle, or `Failure`, to `routines.chain`.
The type that passes: `MeasuredFace` (faces).
May be touched here: trimming and acceptance of lines, with a new version of each
routine that they change.
Watched by: tests/featuresel/routines/edge/test_edge_caliper.py
"""
