"""Plan folders on the disk, cached results, and the text summary of a plan.

In: `Plan` (schemas/plan), `PlanBytes` (planner/plan), arguments and results of pure
functions. Out: a plan folder that is whole or absent; cached results as bytes.
The type that passes: `PlanBytes` (folder).
May be touched here: the summary's wording, the size of the cache, what is cached.
Nothing that `canonical.decode` reads may run code; no foreign file is overwritten.
Watched by: tests/planner/store/test_store.py
"""
