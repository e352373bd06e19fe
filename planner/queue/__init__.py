"""One queue of chunks of work, done by processes of this machine or by a cluster.

In: chunks, picklable pure functions without arguments, and priorities, from
planner.plan and planner.sweep. Out: futures of their results.
The type that passes: `WorkQueue` (work_queue), which `processes` and `cluster` are.
May be touched here: how chunks are shared out, what happens after deaths.
No result may depend on who does a chunk, when, or how often: they are used in the
plan's order. `distributed` is imported in `cluster` only, on demand.
Watched by: tests/planner/queue/test_work_queue.py, which holds for every adapter.
"""
