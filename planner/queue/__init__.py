"""One queue of chunks of work, done by processes here or by a cluster.

In: chunks, picklable functions without arguments whose results depend on nothing else;
priorities. Out: futures. What passes: `work_queue.WorkQueue`, which `processes` and
`cluster` implement.
Which worker does a chunk, when, and how often after deaths must change no result: use
results in the order of the plan, and leave no trace in a worker that a chunk reads.
Tests: tests/planner/queue; test_work_queue holds for every adapter.
"""
