"""Tradeoff: time against error, of a look's images or of a whole task's compiles.

In: a task (`Task`), what to vary, from planner.cli. Out: a folder of CSV, JSON and PNG
files, a table as text, to planner.cli; single images of `microplan render` (`preview`).
The type that passes: `Tradeoff` (tradeoff_record), `TaskTradeoff`
(task_tradeoff_record). May be touched here: figures, tables, what is measured. Keys of
JSON and CSV stay. matplotlib is imported in `plots` and `task_plots` only. Watched by:
tests/planner/tradeoff/test_tradeoff.py, test_task_tradeoff.py.
"""
