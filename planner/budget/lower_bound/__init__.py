"""Lower bound of P(success): what the trials leave open, at a stated confidence.

In: `CompiledStep`'s history (plan), budgets of steps, repeatability of looks (schemas).
Out: `SuccessBound` of schemas.plan, to plan.compiler.
The type that passes: `Level` (sample_bounds), one share of the doubt a bound.
May be touched here: a new bias is one row of `step_bounds.stated_biases`, added
linearly; what a number of trials shows may not, it is in plans.
Watched by: tests/planner/budget/lower_bound/test_run_bound.py
"""
