"""File formats, pages: what compiler shares with runtime.

In: plans from planner.plan, world and evidence from planner.looks. Out: JSON text and
HTML pages, to both commands, and the same types read back by the executor.
The type that passes: `Plan` (`microplan.schemas.plan`).
May be touched here: pages and docstrings; keys of files only with a new version, as
docs/formats.md says. Nothing but the standard library and numpy comes in.
Watched by: tests/schemas/files/test_plan_schema.py.
"""
