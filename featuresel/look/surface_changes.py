"""What walls and faces that are not known change of a look, its target displaced."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.unknown_surfaces import End, surfaced
from microplan.featuresel.routines.contract import LookModel, SurfaceChange

# Places of the target, on a circle; the first three are spread round it, too.
_PLACES, _FEW = 5, 3
_TURN_RAD = 0.2  # so that edges lie elsewhere between pixels at each of them
_RADIUS = 1.5  # standard deviations of the pose


def surface_changes(
    case: LookCase, render: Callable[[LookCase], LookModel]
) -> tuple[SurfaceChange, ...]:
    """Return changes of a look's image by all that its surfaces may be.

    Walls as bright as they may be, as dark, faces as much of mirrors as they may be,
    and what bright walls and mirrors change together beyond their sum. Amounts are the
    share of the interval, near enough: two walls mirror light to each other, too, which
    leaves an eighth of it at half the reflectance.

    Parameters
    ----------
    case : LookCase
        The look as it is planned.
    render : callable
        Returns the renderer of a look.
    """
    if not case.surfaces:
        return ()
    places = _places_um(case)
    few = places[:_FEW]

    plain = render(case)

    def change(of: LookCase, at_um: Sequence[tuple[float, float]]) -> FloatArray:
        other = render(of)
        return np.stack(
            [other(dx_um=x, dy_um=y) - plain(dx_um=x, dy_um=y) for x, y in at_um]
        )

    bright = change(_at_end(case, wall=1), places)
    dark = change(_at_end(case, wall=0), few)
    mirror = change(_at_end(case, finish=1), places)
    both = change(_at_end(case, wall=1, finish=1), few)
    both -= bright[:_FEW] + mirror[:_FEW]
    sigma_um = case.spread.occluder_sigma_um
    return (
        SurfaceChange(
            places_um=places, shown=bright, is_still=True, body_sigma_um=sigma_um
        ),
        SurfaceChange(places_um=few, shown=dark),
        SurfaceChange(places_um=places, shown=mirror),
        SurfaceChange(places_um=few, shown=both),
    )


def _at_end(
    case: LookCase, *, wall: End | None = None, finish: End | None = None
) -> LookCase:
    """Return a look with walls or faces at one end of what they may be."""
    still, moving = (
        surfaced(layers, case.surfaces, wall=wall, finish=finish)
        for layers in (case.static, case.moving)
    )
    return replace(case, static=still, moving=moving)


def _places_um(case: LookCase) -> tuple[tuple[float, float], ...]:
    """Return displacements of the target, as far as its pose is likely to be off."""
    sigma_um = case.drawn.pose_sigma_xy_um
    far_um = max(_RADIUS * sigma_um, case.microscope.um_per_px)
    turns = [_TURN_RAD + 4 * math.pi * k / _PLACES for k in range(_PLACES)]
    return tuple((far_um * math.cos(a), far_um * math.sin(a)) for a in turns)
