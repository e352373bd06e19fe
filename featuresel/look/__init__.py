"""Measurement looks as images: nominal renders, perturbed trials, slopes, templates.

In: `LookCase` from `planner.looks`; layers and renderers from `optics`. Out: images,
(rows, columns) 0..1, to `trials` and `limits`; a `LookModel` to `routines`.
The type that passes: `LookCase` (scenario).
May be touched here: what is rendered once and kept. What a trial perturbs and its seeds
may not: the same task gives the same plan.
Watched by: tests/featuresel/look/test_design.py
"""
