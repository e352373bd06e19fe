"""What a workcell's objective does to light: its wavefront error and halo, if stated.

In: checked workcell files (planner.source). Out: `WavefrontSpec` to planner.task;
findings MP116 at lines that contradict each other.
The type that passes: `WavefrontSpec` (planner.task.workcell).
May be touched here: keys of the wavefront; not what it does to an image (optics).
Watched by: tests/planner/task/lens/test_wavefront.py,
tests/planner/task/lens/test_halo.py
"""
