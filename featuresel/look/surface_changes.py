"""What walls and faces that are not known change of a look, its target displaced."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.perturb import as_tried
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.unknown_surfaces import (
    Shares,
    drawn_surfaces,
    unknown_bodies,
)
from microplan.featuresel.routines.contract import LookModel, SurfaceChange

# Places of the target, on a circle; the first three are spread round it, too.
_PLACES, _FEW = 5, 3
_TURN_RAD = 0.2  # so that edges lie elsewhere between pixels at each of them
_RADIUS = 1.5  # standard deviations of the pose
FLAT, DARK, BRIGHT = (None, None), (0.0, None), (1.0, None)
MIRROR, BOTH = (None, 1.0), (1.0, 1.0)

Places = tuple[tuple[float, float], ...]  # um
Render = Callable[[LookCase], LookModel]


def surface_changes(case: LookCase, render: Render) -> tuple[SurfaceChange, ...]:
    """Return changes of a look's image by all that its surfaces may be.

    All walls as dark as they may be, those of each body as bright instead, the face of
    each as much of a mirror as it may be, and what all bright walls and mirrors change
    together beyond their sum. Amounts are the share of the interval, near enough: two
    walls mirror light to each other, too, which leaves an eighth of it at half the
    reflectance.

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
    few, images = places[:_FEW], _Images(case=case, render=render)
    sigma_um, own = case.spread.occluder_sigma_um, _own_bodies(case)
    walled = {s.body for s in case.surfaces if s.underside_um is not None}
    polished = {s.body for s in case.surfaces if s.finish[1] > s.finish[0]}
    found = [SurfaceChange(places_um=few, shown=images.change(DARK, FLAT, few))]
    for body in unknown_bodies(case.surfaces):
        if body in walled:
            still = body not in own
            at_um = places if still else few
            found.append(
                SurfaceChange(
                    places_um=at_um,
                    shown=images.change(BRIGHT, DARK, at_um, of=body),
                    is_still=still,
                    body_sigma_um=sigma_um if still else 0.0,
                )
            )
        if body in polished:
            shown = images.change(MIRROR, FLAT, places, of=body)
            found.append(SurfaceChange(places_um=places, shown=shown))
    both = images.change(BOTH, BRIGHT, few) - images.change(MIRROR, FLAT, few)
    return (*found, SurfaceChange(places_um=few, shown=both))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Images:
    """Images of a look with its surfaces at some shares, each made once."""

    case: LookCase
    render: Render
    made: dict[tuple[tuple[Shares, ...], tuple[float, float]], FloatArray] = field(
        default_factory=dict
    )

    def change(
        self, there: Shares, here: Shares, places_um: Places, *, of: str = ""
    ) -> FloatArray:
        """Return what other surfaces change, (N, rows, columns): of one body or all."""
        bodies = unknown_bodies(self.case.surfaces)
        before = dict.fromkeys(bodies, here)
        after = {b: there if of in ("", b) else here for b in bodies}
        return self._at(after, places_um) - self._at(before, places_um)

    def _at(self, shares: Mapping[str, Shares], places_um: Places) -> FloatArray:
        """Return the images with the target at some places, (N, rows, columns)."""
        key, case = tuple(shares.values()), self.case
        still, moving = (
            drawn_surfaces(layers, case.surfaces, shares)
            for layers in (case.static, case.moving)
        )
        image = self.render(as_tried(replace(case, static=still, moving=moving)))
        for x, y in places_um:
            if (key, (x, y)) not in self.made:
                self.made[key, (x, y)] = image(dx_um=x, dy_um=y)
        return np.stack([self.made[key, at] for at in places_um])


def _own_bodies(case: LookCase) -> set[str]:
    """Return the bodies that move with the target."""
    names = {layer.name for layer in case.moving}
    return {surface.body for surface in case.surfaces if surface.layer in names}


def _places_um(case: LookCase) -> Places:
    """Return displacements of the target, as far as its pose is likely to be off."""
    sigma_um = case.promised.pose_sigma_xy_um
    far_um = max(_RADIUS * sigma_um, case.microscope.um_per_px)
    turns = [_TURN_RAD + 4 * math.pi * k / _PLACES for k in range(_PLACES)]
    return tuple((far_um * math.cos(a), far_um * math.sin(a)) for a in turns)
