"""Walls and faces of bodies that are known within an interval, as one may be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.optics.render.scene import Layer

Interval = tuple[float, float]
# Shares of the intervals of a body's walls and face, 0 the least; None leaves them.
Shares = tuple[float | None, float | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownSurface:
    """What the walls and the face of a layer's body may reflect as mirrors."""

    layer: str
    body: str  # layers of a body have its walls and its finish
    underside_um: float | None  # world height of the body's lower end; None: no walls
    wall: Interval  # reflectance of the walls
    finish: Interval  # share of the face that is a mirror's


def unknown_bodies(surfaces: Sequence[UnknownSurface]) -> tuple[str, ...]:
    """Return the bodies whose surfaces are not known, each once, in order."""
    return tuple(dict.fromkeys(surface.body for surface in surfaces))


def random_shares(
    surfaces: Sequence[UnknownSurface], rng: np.random.Generator
) -> tuple[tuple[float, float], ...]:
    """Return shares of walls and face of every body, each for itself, uniformly."""
    drawn = rng.random((len(unknown_bodies(surfaces)), 2)).tolist()
    return tuple((wall, finish) for wall, finish in drawn)


def drawn_surfaces(
    layers: Sequence[Layer],
    surfaces: Sequence[UnknownSurface],
    shares: Mapping[str, Shares],
) -> tuple[Layer, ...]:
    """Return layers at the shares of each one's body."""
    known = {surface.layer: surface for surface in surfaces}
    return tuple(
        _at(layer, known[layer.name], *shares[known[layer.name].body])
        if layer.name in known
        else layer
        for layer in layers
    )


def _at(
    layer: Layer, surface: UnknownSurface, wall: float | None, finish: float | None
) -> Layer:
    """Return one layer at its shares."""
    if finish is not None:
        layer = replace(layer, finish=_between(surface.finish, finish))
    if wall is None or surface.underside_um is None:
        return layer
    return replace(
        layer,
        underside_um=surface.underside_um,
        wall_reflectance=_between(surface.wall, wall),
    )


def _between(interval: Interval, share: float) -> float:
    """Return the value at a share of an interval, its ends to the bit."""
    low, high = interval
    return low + share * (high - low) if share < 1 else high
