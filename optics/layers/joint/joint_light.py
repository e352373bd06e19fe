"""Shares of coaxial light that bodies of several heights leave together.

`microplan.optics.layers.coaxial_light` takes the product of what each height leaves.
Rays that pass one of them meet other parts of the next: here is the difference.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.coaxial_light import Irradiance
from microplan.optics.layers.joint.joint_faces import JointFace
from microplan.optics.layers.joint.joint_occlusion import (
    WIDEST,
    joint_residual,
    met_lattice,
    ray_count,
)
from microplan.optics.layers.lattice import MORE, Area, Lattice
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Microscope

_A_RADIUS = 4  # points in the radius of the light that passes the lowest of them
_MOST = 48  # points a side: what changes faster multiplies the difference


@dataclass(frozen=True, slots=True, kw_only=True)
class LightChange:
    """What is added to the product of shades at a height."""

    lattice: Lattice
    change: FloatArray  # (rows, columns), share of the lamp's light

    def on(self, other: Lattice) -> FloatArray:
        """Return it at another lattice, (rows, columns), share of the light."""
        (x, y), step = other.corner_um, other.step_um
        rows, columns = other.shape
        return self.lattice.read(
            self.change,
            (x, step, columns),
            (y, -step, rows),
            beyond_um=(MORE + 2) * step + (MORE + 1) * self.lattice.step_um,
        )


def share_on(
    light: Irradiance, changes: Sequence[LightChange], lattice: Lattice
) -> FloatArray:
    """Return the share of the lamp's light at a lattice, (rows, columns), 0..1."""
    share = light.on(lattice)
    for change in changes:
        share += change.on(lattice)
    return np.clip(share, 0.0, 1.0) if changes else share


def joint_light(
    layers: Sequence[Layer],
    light: Irradiance,
    microscope: Microscope,
    *,
    lamp_aperture: float,
    area: Area,
    finer: float = 1.0,
) -> LightChange | None:
    """Return what the product of shades leaves out, None where one height shades.

    Parameters
    ----------
    layers : sequence of Layer
        Everything that may shade.
    light : Irradiance
        The product of shades at a height.
    lamp_aperture : float
        Of the light through the objective, in (0, n).
    area : Area
        Where the light is wanted, um.
    finer : float
        As `microplan.optics.render.sampling.Sampling.rays`.
    """
    lamp = replace(microscope, aperture=lamp_aperture)
    side = max(area[2] - area[0], area[3] - area[1])

    def radius_um(z_um: float) -> float:
        return lamp.blur_diameter_um(z_um - light.z_um) / 2

    soft = [s for s in light.shades if radius_um(s.z_um) * _MOST > side * _A_RADIUS]
    if len(soft) < 2:
        return None
    heights = {shade.z_um for shade in soft}
    radii = [radius_um(z_um) for z_um in heights]
    step = max(min(radii) / _A_RADIUS, max(radii) / WIDEST)
    step = 2.0 ** math.floor(math.log2(step))  # images nearly alike share their points
    lattice = Lattice.over(area, step)
    rays = ray_count(lattice, finer)
    white = np.ones((2, *lattice.shape), dtype=np.float32)
    faces = [JointFace(z_um=0.0, lattice=lattice, covers=white[0], sends=white[1])]
    above = sorted(
        (layer for layer in layers if layer.z_um in heights), key=lambda la: la.z_um
    )
    for z_um, group in itertools.groupby(above, key=lambda layer: layer.z_um):
        points = met_lattice(lattice, lamp, z_um - light.z_um, rays)
        free = np.ones(points.shape, dtype=np.float32)
        for layer in group:
            free *= 1 - points.covered(layer, finer)
        faces.append(
            JointFace(
                z_um=z_um - light.z_um,
                lattice=points,
                covers=1 - free,
                sends=np.zeros_like(free),
            )
        )
    found = joint_residual(faces, lattice, lamp, rays=rays, diffracts=False)
    if found is None:
        return None
    change = found.above + found.below
    for shade in light.shades:
        if shade not in soft:
            change = change * (1 - np.clip(shade.on(lattice), 0.0, 1.0))
    return LightChange(lattice=lattice, change=change)
