"""Comparison of two plans by meaning, within tolerances.

In: two `Plan`s (schemas/plan) with the pictures of their folders.
Out: `Difference` (to planner/cli) as text, JSON or findings.
The type that passes: `PlanChange` (changes).
May be touched here: tolerances, kinds and trends of values, the wording of changes.
A new key of the plan needs no change unless its lists have entries with names.
Watched by: tests/planner/diff/test_compare.py
"""
