"""Trials of routine chains on perturbed images: outcomes, scores, bounds, gates.

In: `LookCase` from `look`, chains of `routines`. Out: `ChainScore`, `Gate`,
`UsableRange` to `selection`, `sets` and `planner.looks`.
The type that passes: `Outcome` (outcomes).
May be touched here: how outcomes are kept. What counts as wrong, confidence and seeds
may not: scores are in plans.
Watched by: tests/featuresel/trials/test_score.py
"""
