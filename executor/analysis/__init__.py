"""Analysis of runs or pictures against the plan's predictions.

In: run folders (executor.record), a user's pictures of a look, the plan. Out: text,
JSON, marked pictures, report.html, to executor.cli.
The type that passes: `Comparison` (comparison), `Finding` (pictures), `RunArtifacts`
(run_summaries).
May be touched here: tables, wording, charts; a test of a prediction only with its
source.
Watched by: tests/executor/analysis/test_comparison.py, test_pictures.py.
"""
