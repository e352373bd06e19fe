"""Image routines: prepared in the compiler, measured in compiler and executor alike.

In: `LookModel` and `Target` from `look` at preparation, an image, `Artifact` and
`Guess` from `trials` or `executor.run` at measurement. Out: `Measurement` or `Failure`.
The type that passes: `Routine` (contract).
May be touched here: a routine of one's own, by a file and a line in `registry`; a
change of results raises its version. Imports are numpy and cv2 alone.
Watched by: tests/featuresel/routines/test_contract.py
"""
