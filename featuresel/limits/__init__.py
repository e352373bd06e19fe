"""Cramer-Rao limits of a look: the best standard deviation that any routine can reach.

In: `LookCase` and `Sensitivities` from `look`. Out: standard deviations in um to
`selection` and `planner.looks`; contrast through focus to `planner.looks`.
The type that passes: `Information` (information).
May be touched here: how pixels are summed and what counts as observable, as long as the
closed forms of the tests hold.
Watched by: tests/featuresel/limits/test_crlb.py
"""
