"""Parts of pictures with known truth, and others that are nearly like them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from shapely import affinity
from shapely.geometry import MultiPolygon, Polygon, box

from validation.twins import scenes
from validation.twins.scenes import Shape


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinPart:
    """A part, and what lies in its place in windows that are refused."""

    shape: Shape  # um, drawn about the middle of its box
    wrong: Mapping[str, Shape | None]  # None: nothing


def _of_any(part: Shape) -> Mapping[str, Shape | None]:
    """Return what may lie in the place of any part."""
    larger, smaller = (affinity.scale(part, s, s, origin=(0, 0)) for s in (1.05, 0.95))
    outside = affinity.translate(part, -60, 0)
    return {
        "5 % larger": larger, "5 % smaller": smaller, "half outside": outside,
        "nothing": None,
    }  # fmt: skip


def _cut_disc(radius_um: float, flat_um: float) -> Shape:
    """Return a disc cut at x = `flat_um`, drawn about the middle of its nominal box."""
    corner = math.acos(min(flat_um / radius_um, 1.0))
    angle = np.linspace(corner, 2 * math.pi - corner, 1440, endpoint=corner > 0)
    x, y = radius_um * np.cos(angle), radius_um * np.sin(angle)
    return Polygon(np.stack([x + (RADIUS_UM - FLAT_UM) / 2, y], axis=1))


RADIUS_UM, FLAT_UM = 30.0, 20.0  # a disc whose side is cut
_DISC = _cut_disc(RADIUS_UM, FLAT_UM)
_SQUARE = scenes.square_with_notch(44.0, 12.0)
_GEAR = scenes.gear(28.0, 23.0, 10.0, teeth=18)

DOT_UM, PERIOD_UM = 7.75, 15.5  # diameter and period of marks on a chip


def _dots(dot_um: float, period_um: float, *, missing: int | None = None) -> Shape:
    """Return nine dots in a square, or all but one of them."""
    middles = [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]
    return MultiPolygon(
        [
            affinity.translate(scenes.dot(dot_um / 2), period_um * x, period_um * y)
            for k, (x, y) in enumerate(middles)
            if k != missing
        ]
    )


_DOTS = _dots(DOT_UM, PERIOD_UM)

PARTS: Mapping[str, TwinPart] = {
    "dots": TwinPart(
        shape=_DOTS,
        wrong={
            **_of_any(_DOTS),
            "dots 20 % larger": _dots(1.2 * DOT_UM, PERIOD_UM),
            "period 5 % larger": _dots(DOT_UM, 1.05 * PERIOD_UM),
            "a dot missing": _dots(DOT_UM, PERIOD_UM, missing=2),
            "a period on": affinity.translate(_DOTS, PERIOD_UM, 0),
        },
    ),
    "disc": TwinPart(
        shape=_DISC,
        wrong={
            **_of_any(_DISC),
            "no flat": _cut_disc(RADIUS_UM, RADIUS_UM),
            "flat 5 um off": _cut_disc(RADIUS_UM, FLAT_UM + 5),
            "mirrored": affinity.scale(_DISC, -1, 1, origin=(0, 0)),
            "square": box(-25.0, -30.0, 25.0, 30.0),
        },
    ),
    "square": TwinPart(
        shape=_SQUARE,
        wrong={
            **_of_any(_SQUARE),
            "no notch": box(-22.0, -22.0, 22.0, 22.0),
            "notch of half the size": scenes.square_with_notch(44.0, 6.0),
            "mirrored": affinity.scale(_SQUARE, -1, 1, origin=(0, 0)),
            "disc": scenes.dot(24.0),
        },
    ),
    "gear": TwinPart(
        shape=_GEAR,
        wrong={
            **_of_any(_GEAR),
            "17 teeth": scenes.gear(28.0, 23.0, 10.0, teeth=17),
            "half a tooth on": affinity.rotate(_GEAR, 10.0, origin=(0, 0)),
            "teeth half as high": scenes.gear(25.5, 23.0, 10.0, teeth=18),
            "disc": scenes.ring(25.5, 10.0),
        },
    ),
}
