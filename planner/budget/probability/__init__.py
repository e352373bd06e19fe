"""Probabilities of misses: normal errors, a cut-off residual, a fit with tolerances.

In: sigmas in um and rad from budget; slices of fits and `sweep_gaps` (assembly).
Out: probabilities in 0..1 whose small values keep their digits, to budget.
The type that passes: `RoundFit` and `Residual` (fit_probability), `PlaneNormal`
(ellipse_probability), `OutlineFit` (outline_fit).
May be touched here: quadrature nodes and pieces, if the accuracy that the tests state
stays; each formula has a second road in the tests.
Watched by: tests/planner/budget/probability/test_miss_probability.py
"""
