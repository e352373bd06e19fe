"""Surfaces that are not known, in looks that walls change."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from microplan.arrays import Box
from microplan.featuresel.features.feature import contour_px
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.unknown_surfaces import UnknownSurface
from microplan.featuresel.routines.contract import Target
from microplan.optics.light.transmitted import is_clear
from microplan.planner.assembly.assembly import Body

# Mean of a target's normals from which they look one way; a notch takes .05 of a ring.
_ONE_WAY = 0.1


def unknown_surfaces(
    case: LookCase, bodies: Sequence[Body], tools: Collection[str] = ()
) -> tuple[UnknownSurface, ...]:
    """Return what walls and faces in a look may reflect; none where walls hardly count.

    They count where rays from the target's edges to the lens, or from the lens past
    them, meet another body of some thickness; the target's own where its edges look one
    way more than the other: through focus walls move edges along their normals. Light
    from below or aside is left out: there walls are part of every image.

    Parameters
    ----------
    case : LookCase
        The look.
    bodies : sequence of Body
        All that is in the world.
    tools : collection of str
        Owners whose bodies have one surface.
    """
    layers = (*case.static, *case.moving)
    if case.ring is not None or is_clear(layers) or case.treatment == "occluded":
        return ()
    made = by_layer(bodies)
    names = {layer.name for layer in layers} & made.keys()
    if _is_balanced(case.target):
        own = case.target.name.partition(".")[0]
        names = {name for name in names if name.partition(".")[0] != own}
    if not any(_is_by(case, made[name]) for name in names):
        return ()
    return tuple(
        _surface(made[layer.name], layer.name, layer.z_um, tools)
        for layer in layers
        if layer.name in made
    )


def by_layer(bodies: Sequence[Body]) -> Mapping[str, Body]:
    """Return the body of each layer by its name, that of a mark is what it lies on."""
    return {
        name: body
        for body in bodies
        for name in (body.name, *(mark for mark, *_ in body.marks))
    }


def _surface(
    body: Body, layer: str, z_um: float, tools: Collection[str]
) -> UnknownSurface:
    """Return what is known of a layer's body."""
    return UnknownSurface(
        layer=layer,
        body=body.owner if body.owner in tools else body.name,
        underside_um=body.z_low_um if body.z_low_um < z_um else None,
        wall=body.surface.wall,
        finish=body.surface.finish,
    )


def _is_balanced(target: Target) -> bool:
    """Return whether the normals of a target's edges add up to next to nothing."""
    if not target.contour:
        return True
    normal = np.array(target.contour)[:, 2:].mean(axis=0)
    return bool(np.hypot(*normal) < _ONE_WAY)


def _is_by(case: LookCase, body: Body) -> bool:
    """Return whether rays through the target's edges in focus meet a thick body."""
    scope = case.microscope
    if body.z_high_um - body.z_low_um <= scope.wave_depth_um:
        return False
    ends = (body.z_low_um - case.focus_um, body.z_high_um - case.focus_um)
    reach_um = max(scope.blur_diameter_um(end) for end in ends) / 2
    left, low, right, high = _target_box(case)
    x0, y0, x1, y1 = body.outline.bounds_um
    return (
        x0 - reach_um <= right
        and left <= x1 + reach_um
        and y0 - reach_um <= high
        and low <= y1 + reach_um
    )


def _target_box(case: LookCase) -> Box:
    """Return the box about the target's edges, in the world."""
    if not case.target.contour:
        return (case.x_um, case.y_um, case.x_um, case.y_um)
    column, row = contour_px(case.target)
    frame = case.frame
    x, y = zip(*map(frame.to_world, column.tolist(), row.tolist()), strict=True)
    return (min(x), min(y), max(x), max(y))
