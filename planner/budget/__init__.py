"""Error budgets: probability of every step from the sigma of each of its error terms.

In: `CompiledLook` (looks), `StepState` (assembly), verdicts of mechanics.
Out: `Budget`, `Control` and `MethodChoice` of schemas.plan, to plan and report.
The type that passes: `MeasurementHistory` (measurement_history) from step to step,
`Insertion` (insertion) within one.
May be touched here: a new error term is one `BudgetRow`, with its source, in budget.py
or drift_since_look.py; offenders, changes and yield curves follow by themselves.
Watched by: tests/planner/budget/test_budget.py
"""
