"""Rings by arc length: points, normals, stretches of equal kind."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.arrays import BoolArray, FloatArray
from microplan.optics.outline.outline import Arc, Edge, Ring, Segment

IntArray = npt.NDArray[np.int64]

_HALVINGS = 24  # of the distance between two samples: 1e-7 of it is left


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleRun:
    """Samples first .. last of a closed line of `count`, which may go on at its start.

    `last` is at least `first`, and below `first + count`.
    """

    kind: int
    first: int
    last: int

    @property
    def samples(self) -> int:
        """Return how many samples it has."""
        return self.last - self.first + 1


def runs(kinds: IntArray, least: int) -> list[SampleRun]:
    """Return the runs of equal kinds along a closed line.

    Parameters
    ----------
    kinds : (N,) int array
        What each sample is, N >= 1; negative kinds are never changed.
    least : int
        A run of fewer samples between two of one kind becomes one with them.

    Returns
    -------
    list of Run
        In order; one run if all are equal. None begins before the line does.
    """
    found = _split(kinds)
    while lost := _lost(found, least):
        kinds = kinds.copy()
        for index in lost:
            run = found[index]
            where = np.arange(run.first, run.last + 1) % len(kinds)
            kinds[where] = found[index - 1].kind
        found = _split(kinds)
    return found


def border(
    inside: Callable[[FloatArray], BoolArray], within: FloatArray, beyond: FloatArray
) -> FloatArray:
    """Return the last arc lengths, (N,) um, at which `inside` still holds.

    It holds at `within` and not at `beyond`, (N,) each; found by bisection.
    """
    low, high = within.copy(), beyond.copy()
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        holds = inside(middle)
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    return low


def _split(kinds: IntArray) -> list[SampleRun]:
    """Return the runs of equal kinds along a closed line."""
    count = len(kinds)
    begins = np.flatnonzero(kinds != np.roll(kinds, 1))
    if len(begins) == 0:
        return [SampleRun(kind=int(kinds[0]), first=0, last=count - 1)]
    ends = np.append(begins[1:], begins[0] + count) - 1
    return [
        SampleRun(kind=int(kinds[first]), first=int(first), last=int(last))
        for first, last in zip(begins, ends, strict=True)
    ]


def _lost(found: list[SampleRun], least: int) -> list[int]:
    """Return the shortest runs between two alike, no two of them adjacent.

    Those of `least` samples and more are never among them.
    """
    between = [
        index
        for index, run in enumerate(found)
        if run.samples < least
        and min(run.kind, found[index - 1].kind) >= 0
        and found[index - 1].kind == found[(index + 1) % len(found)].kind != run.kind
    ]
    shortest = min((found[index].samples for index in between), default=0)
    lost: list[int] = []
    for index in between:
        if found[index].samples == shortest and (not lost or index > lost[-1] + 1):
            lost.append(index)
    if len(lost) > 1 and lost[0] == 0 and lost[-1] == len(found) - 1:
        lost.pop()  # the last and the first are neighbours
    return lost


LEAST_UM = 1e-6  # of an edge that is left of a cut: below it is rounding


class RingTrack:
    """A ring with the arc length at each of its edges' ends."""

    def __init__(self, ring: Ring) -> None:
        self.ring = ring
        lengths = [edge.length_um for edge in ring.edges]
        self._ends: FloatArray = np.cumsum(lengths)
        self._begins: FloatArray = self._ends - lengths

    @property
    def length_um(self) -> float:
        """Return the length of the ring."""
        return float(self._ends[-1])

    def along(self, way_um: FloatArray) -> FloatArray:
        """Return points of the ring and their normals out of the material.

        Parameters
        ----------
        way_um : (N,) float array
            How far along the ring, um; taken modulo its length. The material is on
            the left of every edge.

        Returns
        -------
        (N, 4) float64 array
            x, y in um, and the unit normal.
        """
        way = np.mod(way_um, self.length_um)
        which = np.searchsorted(self._ends, way, side="right")
        which = np.minimum(which, len(self._ends) - 1)
        order = np.argsort(which, kind="stable")
        found = np.empty((len(way), 4))
        for here in np.split(order, np.flatnonzero(np.diff(which[order])) + 1):
            if len(here):
                index = which[here[0]]
                edge = self.ring.edges[index]
                share = (way[here] - self._begins[index]) / edge.length_um
                found[here] = _on(edge, share)
        return found

    def stretch(self, first_um: float, last_um: float) -> tuple[Edge, ...]:
        """Return the edges between two arc lengths of the ring.

        Parameters
        ----------
        first_um, last_um : float
            From 0 on; `last_um` is the larger, at most by the ring's length, and may
            lie beyond the ring's end.
        """
        return tuple(self._stretch(first_um, last_um))

    def _stretch(self, first_um: float, last_um: float) -> Iterator[Edge]:
        count = len(self.ring.edges)
        index = int(np.searchsorted(self._ends, first_um, side="right"))
        turn = 0.0
        while turn + self._begins[index % count] < last_um:
            edge = self.ring.edges[index % count]
            begin = turn + self._begins[index % count]
            low = max(first_um - begin, 0.0)
            high = min(last_um - begin, edge.length_um)
            if high - low > LEAST_UM:
                yield cut(edge, low / edge.length_um, high / edge.length_um)
            index += 1
            if index % count == 0:
                turn += self.length_um


def cut(edge: Edge, first: float, last: float) -> Edge:
    """Return the part of an edge between two shares (0..1) of its length."""
    if (first, last) == (0.0, 1.0):
        return edge
    if isinstance(edge, Arc):
        return Arc(
            center=edge.center,
            radius_um=edge.radius_um,
            start_rad=edge.start_rad + first * edge.sweep_rad,
            sweep_rad=(last - first) * edge.sweep_rad,
        )
    (x0, y0), (x1, y1) = edge.start, edge.end
    ends = [(x0 + t * (x1 - x0), y0 + t * (y1 - y0)) for t in (first, last)]
    return Segment(start=ends[0], end=ends[1])


def _on(edge: Edge, share: FloatArray) -> FloatArray:
    """Return points and outward normals after shares of one edge, (N, 4)."""
    if isinstance(edge, Segment):
        start, way = np.array(edge.start), np.subtract(edge.end, edge.start)
        normal = np.array([way[1], -way[0]]) / math.hypot(*way)
        points = start + share[:, None] * way
        return np.column_stack((points, np.broadcast_to(normal, points.shape)))
    angle = edge.start_rad + share * edge.sweep_rad
    unit = np.column_stack((np.cos(angle), np.sin(angle)))
    # counter-clockwise the material is inside the circle
    return np.column_stack(
        (
            np.array(edge.center) + edge.radius_um * unit,
            math.copysign(1.0, edge.sweep_rad) * unit,
        )
    )
