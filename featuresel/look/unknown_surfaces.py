"""Walls and faces of bodies that are known within an interval, at one of its ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from microplan.optics.render.scene import Layer

Interval = tuple[float, float]
End = Literal[0, 1]  # the least, the most


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownSurface:
    """What the walls and the face of a layer's body may reflect as mirrors."""

    layer: str
    underside_um: float | None  # world height of the body's lower end; None: no walls
    wall: Interval  # reflectance of the walls
    finish: Interval  # share of the face that is a mirror's


def surfaced(
    layers: Sequence[Layer],
    surfaces: Sequence[UnknownSurface],
    *,
    wall: End | None = None,
    finish: End | None = None,
) -> tuple[Layer, ...]:
    """Return layers with walls, faces or both at one end; None leaves them."""
    known = {surface.layer: surface for surface in surfaces}
    return tuple(_at_end(layer, known, wall, finish) for layer in layers)


def _at_end(
    layer: Layer,
    known: Mapping[str, UnknownSurface],
    wall: End | None,
    finish: End | None,
) -> Layer:
    """Return one layer as `surfaced` has it."""
    surface = known.get(layer.name)
    if surface is None:
        return layer
    if finish is not None:
        layer = replace(layer, finish=surface.finish[finish])
    if wall is None or surface.underside_um is None:
        return layer
    return replace(
        layer,
        underside_um=surface.underside_um,
        wall_reflectance=surface.wall[wall],
    )
