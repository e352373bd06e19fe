"""The coaxial light that reaches a height past walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.coaxial_light import Irradiance
from microplan.optics.layers.joint.joint_light import LightChange, joint_light
from microplan.optics.layers.lattice import Area, Lattice, margin
from microplan.optics.layers.solids.mirrored_rays import RayEnd, first_met, mirrored
from microplan.optics.layers.solids.solid_bodies import (
    MIRRORED,
    LightTable,
    SentLight,
    is_solid,
    rays_from,
    rays_outside,
    solid_bodies,
    thinned,
)
from microplan.optics.layers.solids.straight_rays import ThickBody, covers, hides
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Microscope

_FINEST_UM, _A_BLUR, _SIDE = 6.0, 8, 40  # of points at which light is traced


def light_changes(
    layers: Sequence[Layer],
    light: Irradiance,
    lamp: Microscope,
    *,
    area: Area,
    seen_um: float,
    finer: float = 1.0,
) -> list[LightChange]:
    """Return all that rays add to the product of shades at a height.

    `light` is that product; else arguments are as in `solid_light`.
    """
    if finer == 0:
        return []
    joint = joint_light(
        layers, light, lamp, lamp_aperture=lamp.aperture, area=area, finer=finer
    )
    walls = solid_light(layers, light.z_um, area, seen_um, lamp, finer=finer)
    return [change for change in (joint, walls) if change is not None]


def solid_light(
    layers: Sequence[Layer],
    z_um: float,
    area: Area,
    seen_um: float,
    lamp: Microscope,
    *,
    finer: float = 1.0,
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
    finer : float
        As `microplan.optics.render.sampling.Sampling.rays`.
    """
    over = [layer for layer in layers if layer.z_um > z_um]
    if not is_solid(over):
        return None
    side = max(area[2] - area[0], area[3] - area[1])
    step = max(_FINEST_UM, seen_um / _A_BLUR, side / _SIDE)
    lattice = Lattice.over(area, step / finer, more=margin(finer))
    change = _share(over, z_um, lattice, lamp, less_flat=True, finer=finer)
    return LightChange(lattice=lattice, change=change)


def solid_share(
    layers: Sequence[Layer],
    z_um: float,
    area: Area,
    lamp: Microscope,
    *,
    finer: float = 1.0,
) -> LightTable:
    """Return the light that reaches a height past solid bodies, all over an area.

    Arguments as in `solid_light`.
    """
    side = max(area[2] - area[0], area[3] - area[1])
    lattice = Lattice.over(area, max(_FINEST_UM, side / _SIDE) / finer, more=0)
    over = [layer for layer in layers if layer.z_um > z_um]
    share = np.ones(lattice.shape)
    if over:
        found = _share(over, z_um, lattice, lamp, less_flat=False, finer=finer)
        share = np.clip(found, 0.0, 1.0)
    return LightTable(lattice=lattice, share=share.astype(np.float32))


def _share(
    over: Sequence[Layer],
    z_um: float,
    lattice: Lattice,
    lamp: Microscope,
    *,
    less_flat: bool,
    finer: float = 1.0,
) -> FloatArray:
    """Return the share of the lamp's light at a lattice's points, (rows, columns).

    `less_flat`: less that past flat faces.
    """
    top_um = max(layer.z_um for layer in over)
    area = _grown(lattice, lamp.blur_diameter_um(top_um - z_um) / 2)
    bodies = [body for _, body in solid_bodies(over, z_um, area, -1.0)]
    rays, soft = rays_from(lattice, lamp, finer=finer)
    solid = np.ones((rays.x_um.size, rays.across.size), dtype=np.float32)
    flat = solid.copy()
    for body in bodies:
        low_um = max(body.under_um, 0.0)
        touching = _from_below(body)
        solid *= 1 - hides(touching, rays, soft, from_um=low_um, to_um=body.top_um)
        flat *= 1 - covers(body, rays, soft)
    if less_flat:
        solid -= flat
    found: FloatArray = solid.mean(axis=1, dtype=np.float64)
    if any(body.wall_reflectance > 0 for body in bodies):
        turned = [_turned(body) for body in bodies]
        nothing: list[RayEnd | None] = [None] * len(turned)
        # as many as straight ones of trials, not fewer
        count = thinned(MIRRORED, math.sqrt(finer))
        few, _ = rays_from(lattice, lamp, count, finer=finer)
        outside = rays_outside([b for b in bodies if b.under_um <= 0], few)
        sky = SentLight(reflectance=1.0, finish=0.0)
        ceiling_um = -(top_um - z_um) - 1.0
        met = first_met(turned, ceiling_um, outside)
        sums = mirrored(turned, nothing, sky, ceiling_um, outside, met)
        found += sums / few.across.size
    return found.reshape(lattice.shape)


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
