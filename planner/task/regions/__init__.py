"""Regions: closed rings of a drawing as things to look at: which, where, how alike.

In: `Ring` from optics.outline, in any frame. Out: the ring that a feature means, its
centroid, the order of its symmetry, its teeth, to planner.task.
The type that passes: `Ring`; `Teeth` (teeth).
May be touched here: the shares that say what counts as teeth or as symmetrical.
Ask first: the order of rings (`by_size`): task files count by it.
Watched by: tests/planner/task/regions/test_symmetry.py, test_teeth.py
"""
