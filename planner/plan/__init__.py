"""Compilation of a task to a plan: steps, actions, conditions, requirements.

In: `Task` (task), `StepState` (assembly), `Options` of the command line (cli).
Out: `PlanFiles`, then `PlanBytes`, to store; findings to `Report` (source).
The type that passes: `CompiledStep` (steps), one after the other.
May be touched here: what a step's action, conditions and requirements hold, with the
plan format (schemas.plan) and its golden plans; the order of stages.
Watched by: tests/planner/plan/test_compile.py
"""
