"""Sweep: one task compiled with many values of its keys, a row of a table each.

In: a task file, settings as text, from planner.cli. Out: `rows.jsonl` and `sweep.csv`
in a folder, lines of a table as they come, to planner.cli.
The type that passes: `Variant` (variants), `SweepRow` (rows).
May be touched here: columns, what is said. Keys of both files stay.
A row is one chunk of planner.queue: who makes it, and when, changes no value but times.
Watched by: tests/planner/sweep/test_sweeping.py
"""
