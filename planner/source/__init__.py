"""Findings with their positions in the user's YAML and JSON files.

In: paths of task, workcell and drawings, as the user names them.
Out: `Source`, `Checked` (to planner/task), `Report` (to every stage of the compiler).
The type that passes: `Diagnostic` (diagnostics).
May be touched here: wording of messages and hints, limits on sizes. A code keeps its
meaning, has a page in docs/diagnostics/, and is never used for something else.
Watched by: tests/planner/source/test_diagnostic_pages.py
"""
