"""Inputs as normalised plain data: the same meaning gives equal values."""

from __future__ import annotations

import math
from typing import Any

from microplan.optics.outline.outline import Edge, Outline, Segment

_BETWEEN = math.e / 100  # of the last digit: no decimal fraction ends there


def plain(data: Any) -> Any:
    """Return a copy of `data` with keys sorted and every number a float."""
    if isinstance(data, dict):
        return {key: plain(data[key]) for key in sorted(data)}
    if isinstance(data, list):
        return [plain(item) for item in data]
    if isinstance(data, int) and not isinstance(data, bool):
        return float(data)
    return data


def plain_outline(outline: Outline) -> list[list[list[Any]]]:
    """Return an outline's rings as lists of numbers, to 1e-6 um and 1e-9 rad.

    Finer differences come from converting units, not from the drawing.
    """
    return [[_edge(edge) for edge in ring.edges] for ring in outline.rings]


def plain_lengths(*lengths_um: float) -> list[float]:
    """Return lengths to 1e-6 um, as those of outlines."""
    return [_round(length, 6) for length in lengths_um]


def _edge(edge: Edge) -> list[Any]:
    if isinstance(edge, Segment):
        return ["line", *(_round(v, 6) for v in (*edge.start, *edge.end))]
    lengths = (*edge.center, edge.radius_um)
    angles = (edge.start_rad, edge.sweep_rad)
    return ["arc", *(_round(v, 6) for v in lengths), *(_round(v, 9) for v in angles)]


def _round(value: float, digits: int) -> float:
    """Round; what is half-way in decimals goes up whatever its last bit is."""
    return round(value + _BETWEEN * 10.0**-digits, digits) + 0.0  # no -0.0
