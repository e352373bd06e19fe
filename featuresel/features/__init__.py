"""Features of a drawn outline that a look can measure: circles, teeth, edges, corners.

In: `Outline` from `optics.outline`, declared features from `planner.task`. Out: tuples
of `Feature` to `sets` and `planner.looks`; contours of a `Target` to `look`.
The type that passes: `Feature` (feature).
May be touched here: shares and angles that say what counts as a feature, `MOST` of a
kind. Names and order of features are in plans: a change of them is one of the format.
Watched by: tests/featuresel/features/test_features.py
"""
