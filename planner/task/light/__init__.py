"""Light of a workcell: its kind, with what that kind needs of lamp, stage and bodies.

In: checked workcell and task files (planner.source). Out: `LightSpec`, `Coherence` to
planner.task; findings MP119 and MP120 at the lines that lack a number.
The type that passes: `LightSpec` (planner.task.workcell).
May be touched here: which keys a kind of light needs; the intervals of a coherence that
is not stated, with docs/model.md.
Watched by: tests/planner/task/light/test_check_light.py.
"""
