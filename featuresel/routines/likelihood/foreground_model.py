"""What stands before, behind and beside a target, as it changes the target's light."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import LookModel, Occluders, Target

_DEPTHS = 2.0  # wave depths of field between heights: what is in front is blurred
_MOST = 9  # heights: each takes a dozen images
_MOVED_PX = 1.5  # displacements that the light is compared at
_FAR = 0.5  # of the search, along both axes
_SAME = 0.002  # of full scale: an image that differs less from the target alone is it
# Of the way to what stands in front: there a tenth of its light seems to come from, by
# the exact law at an aperture of .42 against Hopkins'; .2 to .3 serve equally well.
_CORE = 0.3
_FLAT = 1e-3  # per px: what is no steeper has no edge
_DOUBT = 0.02  # of full scale: where the target's light varies less, the veil decides


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontMaps:
    """Image = light + through x target alone, pixel by pixel, at some focus heights."""

    light: FloatArray  # (K, rows, columns), K odd
    through: FloatArray  # (K, rows, columns)
    core_light: FloatArray  # (K, rows, columns) what less blur of it changes them by
    core_through: FloatArray  # (K, rows, columns)


def front_maps(
    model: LookModel, target: Target, image: FloatArray, reach_um: float
) -> FrontMaps | None:
    """Return how a look differs from its target alone; None if it does not.

    Parameters
    ----------
    model : LookModel
        The look.
    target : Target
        What is to be found.
    image : (rows, columns) float array
        The nominal image.
    reach_um : float
        Heights are at equal steps from -reach to reach off nominal focus.

    Notes
    -----
    A line through what each pixel shows against the target alone, at nine places of the
    target, near nominal and as far as it is sought: what covers or shades it, what is
    seen beside it, and what shades what. The slope is that of `LookModel.veil` where
    the target's light hardly varies.
    """
    if float(np.abs(image - np.clip(model.alone(), 0, 1)).max()) < _SAME:
        return None
    count = 2 * math.ceil(reach_um / (_DEPTHS * model.blur.depth_um)) + 1
    heights = np.linspace(-reach_um, reach_um, min(count, _MOST))
    found = [_at_height(model, target, float(dz)) for dz in heights]
    cores = _cores(model, target, heights)
    return FrontMaps(
        light=np.stack([light for light, _ in found]),
        through=np.stack([through for _, through in found]),
        core_light=np.stack([core.light for core in cores]),
        core_through=np.stack([core.through for core in cores]),
    )


def _cores(model: LookModel, target: Target, heights: FloatArray) -> list[Occluders]:
    """Return what less blur of what stands in front changes, at some focus heights."""
    near_um = _CORE * _height_um(model, target)
    found = []
    for dz in heights.tolist():
        seen, core = model.occluders(dz), model.occluders(dz + near_um)
        change = Occluders(
            light=core.light - seen.light, through=core.through - seen.through
        )
        found.append(change)
    return found


def _height_um(model: LookModel, target: Target) -> float:
    """Return how far above nominal focus the edges of what stands in front are.

    An edge blurred to a disc of radius R is nowhere steeper than 2 / (pi R).
    """
    step_um = model.blur.depth_um
    below, here, above = (
        max(float(np.abs(g).max()) for g in np.gradient(model.occluders(dz).through))
        for dz in (-step_um, 0.0, step_um)
    )
    if here < _FLAT:
        return 0.0
    height_um = 2 / (math.pi * here * model.blur.cone * target.px_per_um)
    return math.copysign(height_um, above - below)


def _at_height(
    model: LookModel, target: Target, dz_um: float
) -> tuple[FloatArray, FloatArray]:
    """Return light and share let through at one focus height."""
    near = _MOVED_PX / target.px_per_um
    far = max(_FAR * target.search_px, _MOVED_PX) / target.px_per_um
    moves = [(0.0, 0.0), (near, 0.0), (-near, 0.0), (0.0, near), (0.0, -near)]
    moves += [(far, far), (-far, far), (far, -far), (-far, -far)]
    alone = np.stack([model.alone(dx_um=x, dy_um=y, dz_um=dz_um) for x, y in moves])
    seen = np.stack([model(dx_um=x, dy_um=y, dz_um=dz_um) for x, y in moves])
    assumed = model.occluders(dz_um).through
    off, shown = alone - alone.mean(axis=0), seen - seen.mean(axis=0)
    doubt = len(moves) * _DOUBT**2
    slope = (off * shown).sum(axis=0) + doubt * assumed
    through: FloatArray = slope / ((off**2).sum(axis=0) + doubt)
    light: FloatArray = seen.mean(axis=0) - through * alone.mean(axis=0)
    return light, through
