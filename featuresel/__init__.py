"""Selection of features with the routines that find them, by trials on rendered looks.

In: `LookCase` and drawn parts from `planner.looks`; images from `executor.run`. Out:
`RoutineComparison`, `FeatureSet` to `planner.looks`; `Measurement` to `executor.run`.
The type that passes: `LookCase` (look.scenario).
May be touched here: thresholds with their tests; an import of the renderer stays out of
`routines`, of files and clocks out of the whole package.
Watched by: tests/featuresel/routines/test_contract.py
"""
