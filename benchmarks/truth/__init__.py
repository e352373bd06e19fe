"""The compiler's pictures against the simulated cell's, and both against waves.

In: an example's task and plan folder. Out: figures `truth.*`.
The type that passes: `JudgedLook` (judged_looks).
May be touched here: which looks, how many samples; never what either side renders with.
Watched by: tests/benchmarks/truth/test_waves.py, test_comparison.py.
"""
