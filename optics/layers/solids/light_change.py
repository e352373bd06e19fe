"""What walls change of the coaxial light that reaches a height."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.joint_light import LightChange
from microplan.optics.layers.lattice import Area, Lattice
from microplan.optics.layers.solids.mirrored_rays import RayEnd, mirrored
from microplan.optics.layers.solids.solid_bodies import (
    MIRRORED,
    SentLight,
    is_solid,
    rays_from,
    rays_outside,
    solid_bodies,
)
from microplan.optics.layers.solids.straight_rays import ThickBody, covers, hides
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Microscope

_FINEST_UM, _A_BLUR, _SIDE = 6.0, 8, 40  # of points at which light is traced


def solid_light(
    layers: Sequence[Layer], z_um: float, area: Area, seen_um: float, lamp: Microscope
) -> LightChange | None:
    """Return what walls change of the light that reaches a height.

    Parameters
    ----------
    layers : sequence of Layer
        Everything that may shade.
    z_um : float
        World height of the face.
    area : Area
        Where the light is wanted, um.
    seen_um : float
        Radius of the blur by which the face is seen.
    lamp : Microscope
        With the lamp's aperture.
    """
    over = [layer for layer in layers if layer.z_um > z_um]
    if not is_solid(over):
        return None
    side = max(area[2] - area[0], area[3] - area[1])
    step = max(_FINEST_UM, seen_um / _A_BLUR, side / _SIDE)
    lattice = Lattice.over(area, step)
    top_um = max(layer.z_um for layer in over)
    area = _grown(lattice, lamp.blur_diameter_um(top_um - z_um) / 2)
    found = [body for _, body in solid_bodies(over, z_um, area, -1.0)]
    rays, soft = rays_from(lattice, lamp)
    solid = np.ones((rays.x_um.size, rays.across.size), dtype=np.float32)
    flat = solid.copy()
    for body in found:
        low_um = max(body.under_um, 0.0)
        touching = _from_below(body)
        solid *= 1 - hides(touching, rays, soft, from_um=low_um, to_um=body.top_um)
        flat *= 1 - covers(body, rays, soft)
    change: FloatArray = (solid - flat).mean(axis=1, dtype=np.float64)
    if any(body.wall_reflectance > 0 for body in found):
        turned = [_turned(body) for body in found]
        nothing: list[RayEnd | None] = [None] * len(turned)
        few, _ = rays_from(lattice, lamp, MIRRORED)
        outside = rays_outside([b for b in found if b.under_um <= 0], few)
        sky = SentLight(reflectance=1.0, finish=0.0)
        ceiling_um = -(top_um - z_um) - 1.0
        change += mirrored(turned, nothing, sky, ceiling_um, outside) / few.across.size
    return LightChange(lattice=lattice, change=change.reshape(lattice.shape))


def _from_below(body: ThickBody) -> ThickBody:
    """Return a body as rays from a face at 0 meet it: sharply where it stands there."""
    return replace(body, is_sharp=body.under_um <= 0)


def _turned(body: ThickBody) -> ThickBody:
    """Return a body upside down, for rays that come up from 0."""
    return replace(
        body, top_um=min(-body.under_um, 0.0), under_um=-body.top_um, is_sharp=False
    )


def _grown(lattice: Lattice, by_um: float) -> Area:
    """Return the area of a lattice and so much on all sides."""
    (left, top), step = lattice.corner_um, lattice.step_um
    rows, columns = lattice.shape
    return (left - by_um, top - step * rows - by_um,
            left + step * columns + by_um, top + by_um)  # fmt: skip
