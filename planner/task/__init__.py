"""Task: the user's task, workcell and parts, read and checked.

In: YAML sources (`Source`, `Checked`) from planner.source; outlines (`Taken`) from
planner.drawings.
Out: the typed task to every later stage; parts as text or SVG to planner.cli.
The type that passes: `Task` (planner.task.task), with its `Workcell`.
May be touched here: checks of values, presets, the summary, the pictures of parts.
Ask first: `Task.normalised`: hashes, caches and plan folders depend on it.
Watched by: tests/planner/task/test_read_task.py, test_features.py.
"""
