"""Share of a ring of light that bodies leave to a face below them.

A ray from a point of the face towards the ring passes the heights of a body over a
stretch of the plane: it is stopped where that stretch meets the body's outline. Walls
and undersides count: the body is a prism.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from microplan.arrays import Float32Array, FloatArray
from microplan.optics.layers.coaxial_light import Irradiance, LayerShade
from microplan.optics.layers.lattice import MORE, Area, Lattice
from microplan.optics.layers.solids.solid_bodies import LightTable
from microplan.optics.light.lamps import RingLamp, directions
from microplan.optics.render.scene import Layer

DIRECTIONS = (
    96  # to the ring: their pattern errs by 1 / sqrt(DIRECTIONS) of one's share
)
_A_SHADOW = 12  # points in the length of the shortest shadow
_MOST = 120  # points a side: what changes faster is a mean over them
_WIDE = 40  # points a side of what mirrored rays meet


def ring_irradiance(
    layers: Sequence[Layer],
    z_um: float,
    lamp: RingLamp,
    area: Area,
    finest_um: float,
) -> Irradiance:
    """Return the share of a ring's light on a height, without shades if all arrives.

    Parameters
    ----------
    layers : sequence of Layer
        Everything that may stand in the light; those at the height and below do not.
    z_um : float
        World height of the face.
    lamp : RingLamp
        The light.
    area : Area
        Where it is wanted, um.
    finest_um : float
        Distance of points below which nothing is resolved.
    """
    above = [layer for layer in layers if layer.z_um > z_um and layer.outline.rings]
    if not above:
        return Irradiance(z_um=z_um, shades=())
    steep = math.tan(lamp.high_rad) if lamp.high_rad < math.pi / 2 else math.inf
    shortest_um = min(layer.z_um - z_um for layer in above) / steep
    side = max(area[2] - area[0], area[3] - area[1])
    step = max(finest_um, shortest_um / _A_SHADOW, side / _MOST)
    lattice = Lattice.over(area, step, more=MORE + 1)
    share = ring_share(above, z_um, lamp, lattice)
    if share is None:
        return Irradiance(z_um=z_um, shades=())
    top_um = max(layer.z_um for layer in above)
    shade = LayerShade(z_um=top_um, lattice=lattice, kept=1 - share)
    return Irradiance(z_um=z_um, shades=(shade,))


def ring_table(
    layers: Sequence[Layer], z_um: float, area: Area, lamp: RingLamp
) -> LightTable:
    """Return the share of a ring's light on a height, all over an area, um."""
    side = max(area[2] - area[0], area[3] - area[1])
    lattice = Lattice.over(area, side / _WIDE, more=0)
    above = [layer for layer in layers if layer.z_um > z_um]
    found = ring_share(above, z_um, lamp, lattice)
    share = np.ones(lattice.shape) if found is None else found
    return LightTable(lattice=lattice, share=share.astype(np.float32))


def ring_share(
    above: Sequence[Layer], z_um: float, lamp: RingLamp, lattice: Lattice
) -> FloatArray | None:
    """Return the share of the ring seen from points of a height, (rows, columns) 0..1.

    None where no body stands in its light.
    """
    rays = directions(lamp, DIRECTIONS)
    free = np.ones((len(rays), *lattice.shape), dtype=np.float32)
    for layer in above:
        _darken(free, layer, z_um, rays, lattice)
    found: FloatArray = free.mean(axis=0, dtype=np.float64)
    return None if found.min() > 1 - 1e-6 else found


def _darken(
    free: Float32Array, layer: Layer, z_um: float, rays: FloatArray, lattice: Lattice
) -> None:
    """Multiply what rays have left by what a body leaves of them, in place."""
    top_um = layer.z_um - z_um
    low_um = top_um if layer.underside_um is None else layer.underside_um - z_um
    step = lattice.step_um
    reach = math.ceil(top_um * float(np.hypot(*rays.T).max()) / step) + 1
    body = lattice.grown(reach).held_cells(layer)
    if not body.any():
        return
    rows, columns = lattice.shape
    for k, ray in enumerate(rays):
        hidden = np.zeros(lattice.shape, dtype=np.float32)
        for right, up in _stations(ray / step, max(low_um, 0.0), top_um):
            row, column = reach - up, reach + right
            met = body[row : row + rows, column : column + columns]
            np.maximum(hidden, met, out=hidden)
        free[k] *= 1 - hidden


def _stations(
    ray: FloatArray, low_um: float, top_um: float
) -> Iterator[tuple[int, int]]:
    """Yield the points that a ray passes over between two heights, (right, up)."""
    length = float(np.hypot(*ray)) * (top_um - low_um)
    heights = np.linspace(low_um, top_um, math.ceil(length) + 1)
    places = np.rint(heights[:, None] * ray).astype(np.intp)
    last = None
    for right, up in places.tolist():
        if (right, up) != last:
            yield right, up
        last = (right, up)
