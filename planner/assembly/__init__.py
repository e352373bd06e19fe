"""Assembly: the state machine of who holds what, motions free of collisions.

In: the task (`Task`), from planner.task.
Out: states of every step (`StepState`), bodies, hits, fits, to planner.views,
planner.mechanics, planner.budget, planner.plan; the cell's world (`World`) to its file.
The type that passes: `State` (planner.assembly.assembly), in a `StepState`.
May be touched here: words of findings MP301 to MP309, shapes of clearance.
Ask first: `SIGMAS`, `CHORD_UM`: refusals of tasks depend on them.
Watched by: tests/planner/assembly/test_step_states.py, test_swept_volume.py.
"""
