"""Mechanics: adhesion, gripping, releasing, each as intervals of force.

In: states of a step (`StepState`) from planner.assembly, materials from planner.task.
Out: verdicts (`GraspVerdict`, `ReleaseVerdict`) with rows of the ledger, to
planner.plan and planner.budget.
The type that passes: `Force` (schemas.plan.verdicts), bounds in uN.
May be touched here: materials, wording of reasons.
Ask first: constants of the force models: each has its source in `adhesion`.
Watched by: tests/planner/mechanics/test_adhesion.py, test_gripping.py.
"""
