"""Pieces of a free region, followed from slice to slice."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry import Point

from microplan.planner.assembly.fits.peg_in_hole import Pieces


def components(turns: Sequence[float], slices: Sequence[Pieces]) -> list[list[int]]:
    """Return a name for each piece of each slice: one for what hangs together.

    Pieces of neighbouring slices that overlap do; so do the first and last ones.
    """
    names: list[list[int]] = []
    parents: list[int] = []
    for pieces in slices:
        names.append(list(range(len(parents), len(parents) + len(pieces))))
        parents += names[-1]
    pairs = list(pairwise(range(len(slices))))
    if turns[-1] - turns[0] >= math.tau - 1e-9:
        pairs.append((len(slices) - 1, 0))
    flat = np.array([piece for pieces in slices for piece in pieces], dtype=object)
    sides = [(a, b) for here, there in pairs for a in names[here] for b in names[there]]
    one, other = np.array(sides, dtype=np.intp).reshape(-1, 2).T
    meet = np.flatnonzero(shapely.intersects(flat[one], flat[other]))
    for a, b in zip(one[meet].tolist(), other[meet].tolist(), strict=True):
        parents[_root(parents, a)] = _root(parents, b)
    return [[_root(parents, name) for name in owned] for owned in names]


def _root(parents: list[int], name: int) -> int:
    while parents[name] != name:
        name = parents[name]
    return name


def planned_piece(
    turns: Sequence[float],
    slices: Sequence[Pieces],
    names: Sequence[list[int]],
    reach_um: float,
) -> int:
    """Return the name of the piece that holds the planned pose, else the nearest one.

    A turn is as far as it moves a point `reach_um` away; -1 if there is no piece.
    """
    middle = Point(0.0, 0.0)
    found = [
        (abs(turn) * reach_um + piece.distance(middle), name)
        for turn, pieces, owned in zip(turns, slices, names, strict=True)
        for piece, name in zip(pieces, owned, strict=True)
    ]
    return min(found)[1] if found else -1
