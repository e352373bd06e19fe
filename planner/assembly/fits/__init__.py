"""Fits of a planar peg in a planar hole: the poses in which it does not touch.

In: outlines of a post and of the ring that is the hole, with offsets as fabricated.
Out: slices of the free region at one angle (shapely), to mating and budget.
The type that passes: `PegInHole` (peg_in_hole).
May be touched here: how a slice is found; what it is stays the erosion of the hole by
the rotated peg.
Watched by: tests/planner/assembly/fits/test_free_slice.py
"""
