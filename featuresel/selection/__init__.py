"""Choice of a look's routine chain: races over trials, constraints, a reason for each.

In: `LookCase` and `Limits` from `planner.looks`; outcomes and scores from `trials`.
Out: `RoutineComparison` to `planner.looks`.
The type that passes: `Selection` (select).
May be touched here: rounds and reasons. Reasons are in plans, and confidence bounds
hold for all rounds at once: more rounds widen them.
Watched by: tests/featuresel/selection/test_select.py
"""
