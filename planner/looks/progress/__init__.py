"""How far a compile has come: images of looks, planned and made.

In: `Effort`; what stages of looks tell. Out: `CompileProgress` to planner.cli.
The type that passes: `Work` (work).
May be touched here: what a stage weighs. It changes no result.
Watched by: tests/planner/looks/progress/test_work.py
"""
