"""The compiler: task, workcell, drawings in, an augmented plan out.

In: task and workcell files, drawings (read by source, task, drawings).
Out: a plan folder (store), reports, exports and differences made of it.
The type that passes: `Task` (task) down to `Plan` (schemas.plan).
May be touched here: a folder imports only folders below it, in this order: cli;
tradeoff; plan, report, export; budget, diff; looks; views, mechanics; assembly; task;
drawings, store; source. Its sign says what passes.
Watched by: the import contracts, and tests/planner/plan/test_compile.py
"""
