"""A look as it is where what stands still lies elsewhere, each owner for itself."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from microplan.featuresel.look.disturb import turned
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.outline.outline import place
from microplan.optics.render.scene import Layer

_TURNS = 12  # of the circle, where an angle is unknown: blur leaves its first waves


def displaced_look(case: LookCase) -> Iterator[tuple[LookCase, float]]:
    """Yield the look with what stands still elsewhere, and the root of its weight."""
    own = case.target.name.partition(".")[0]
    names = sorted({layer.name.partition(".")[0] for layer in case.static} - {own})
    sigma = case.spread.occluder_sigma_um
    for name in names if sigma > 0 else ():
        for x, y in ((sigma, 0.0), (-sigma, 0.0), (0.0, sigma), (0.0, -sigma)):
            moved = _moved(case.static, name, x, y)
            yield replace(case, static=moved), math.sqrt(1 / 2)
    for what in case.spread.turning:
        turns = [what.sigma_theta_rad, -what.sigma_theta_rad]
        if what.is_any:
            turns = [2 * math.pi * k / _TURNS for k in range(1, _TURNS)]
        for turn in turns:
            weight = 1 / (_TURNS if what.is_any else 2)
            there = turned(case.static, what, turn)
            yield replace(case, static=there), math.sqrt(weight)


def _moved(
    layers: tuple[Layer, ...], owner: str, x_um: float, y_um: float
) -> tuple[Layer, ...]:
    """Return layers with those of one owner moved."""
    return tuple(
        replace(layer, outline=place(layer.outline, x_um, y_um, 0.0))
        if layer.name.partition(".")[0] == owner
        else layer
        for layer in layers
    )
