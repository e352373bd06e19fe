"""Paths of entities: chains of curves, checked to be B-splines where they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from microplan.planner.drawings.dxf.curves import Shape

MOST_WORK = 200_000  # degree squared times control points: 2 s


class UnreadableError(ValueError):
    """An entity has no exact reading, though its numbers are in order."""


@dataclass(frozen=True, slots=True)
class Path:
    """Shapes, each beginning where the one before ends, in the entity's coordinates."""

    shapes: tuple[Shape, ...]
    closed: bool = False
    rise: float = 0.0  # between its lowest and its highest point
    stroke: bool = False  # the border of a line with a width


def knots_fit(
    degree: int,
    knots: Sequence[float],
    points: Sequence[complex],
    weights: Sequence[float],
) -> list[tuple[complex, float]]:
    """Return control points with weights after checking that they make a B-spline.

    Raises
    ------
    UnreadableError
        If they are more than MOST_WORK.
    ValueError
        If counts do not fit each other, knots fall or weights are not positive.
    """
    if len(knots) != len(points) + degree + 1:
        raise ValueError(
            f"degree {degree}, {len(points)} control points and {len(knots)} knots "
            "do not fit together"
        )
    if degree**2 * len(points) > MOST_WORK:
        raise UnreadableError(
            f"degree {degree} with {len(points)} control points is too much, at most "
            f"{MOST_WORK // degree**2}"
        )
    if any(b < a for a, b in pairwise(knots)):
        raise ValueError("its knots fall")
    weights = weights or [1.0] * len(points)
    if len(weights) != len(points) or min(weights) <= 0:
        raise ValueError("its weights are not one positive number a control point")
    return list(zip(points, weights, strict=True))
