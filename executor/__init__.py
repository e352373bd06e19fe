"""The runtime: a plan goes in, motion comes out.

In: a plan folder (schemas.plan) with a station file, or the simulated cell.
Out: a run folder: events, journal, record of calls, frames, summary, report.
The type that passes: `Rig` (executor.run.run_context).
May be touched here: nothing but this sign; each folder has its own. The standard
library and numpy alone are imported at start: a run begins at once.
Watched by: tests/executor/test_imports.py, tests/executor/whole_runs.
"""
