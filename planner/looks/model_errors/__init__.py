"""Cost of image-model errors in um: a look's chains on pairs of images.

In: a look's case with its effects ledger, its chains (looks), bodies (assembly).
Out: `LookCost` with mean, half-width and standard deviation, to looks and budget.
The type that passes: `BetterModel` (better_models): how an effect is imaged better.
May be touched here: a ledger row's better model is one entry of `better_models`; what
has none refuses the look. Poses are those in which the answer is used.
Watched by: tests/planner/looks/model_errors/test_model_cost.py
"""
