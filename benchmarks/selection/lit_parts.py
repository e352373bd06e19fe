"""Random parts in light from below and from a ring, judged ray by ray.

The prediction is what routines are prepared with; the truth follows single rays through
sharp prisms (`tests/optics/light/sharp_rays.py`), with points spread over a pixel and
over the lens' resolution, by which the sides lie off an edge. A bright line is compared
with the outside of its edge.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from benchmarks.selection.random_parts import random_case
from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase, scene
from microplan.featuresel.routines.contour.polarity import place, predict
from microplan.optics.light.lamps import RingLamp, edge_line
from microplan.optics.light.ring import line_layer
from microplan.optics.render.scene import Layer
from tests.optics.light.sharp_rays import (
    SharpPrism,
    seen_from_below,
    seen_under_ring,
    sharp_polygon,
)

KINDS = ("transmitted", "ring", "line")
POINTS = 24  # kept edges of a part that are judged
_THICK_UM, _FLOOR_UM = 20.0, -90.0
_LAMP, _FIELD = 0.3, 0.9
_RING = RingLamp(low_rad=math.radians(20), high_rad=math.radians(45))
_FINISH, _ROUND_UM, _FINE_UM = 0.6, 2.0, 0.3
_NEAR = 1 / 6  # of the focus that parts in front light have: edges stay apart
_RAYS, _TO_RING = 400, 12
_MORE, _ROUNDS = 16, 2  # times as many rays for sides that are not told apart by
_SURE = 4.0  # standard errors
_AIRY = 0.35  # standard deviation of the points over the Airy radius
_ASIDE = 1.0  # of the Airy radius, where an edge's sides are compared


def judged(kind: str, seed: tuple[int, int]) -> tuple[int, int, int]:
    """Return points, kept points and, of `POINTS` of those, wrong ones of one part."""
    case = lit_case(random_case(np.random.default_rng(seed)), kind)
    found = predict(nominal_render(case), case.target)
    kept = np.flatnonzero(found.kept)
    if not len(kept):
        return len(found.kept), 0, 0
    some = kept[:: max(1, math.ceil(len(kept) / POINTS))]
    where = place(np.array(case.target.contour), case.target)[some]
    brighter = _outside_less_inside(case, where[:, :2], where[:, 2:])
    wrong = brighter * found.step[some] <= 0
    return len(found.kept), len(kept), int(wrong.sum())


def lit_case(case: LookCase, kind: str) -> LookCase:
    """Return a look at a random part in light of another kind."""
    lit = replace(
        case,
        focus_um=case.focus_um * _NEAR,
        static=tuple(_solid(layer) for layer in case.static),
        moving=tuple(_solid(layer) for layer in case.moving),
        background_z_um=_FLOOR_UM,
    )
    if kind == "transmitted":
        scope = replace(case.microscope, lamp_aperture=_LAMP)
        share = (scope.cone_aperture / scope.aperture) ** 2
        return replace(
            lit,
            static=tuple(replace(la, reflectance=0.0) for la in lit.static),
            moving=tuple(replace(la, reflectance=0.0) for la in lit.moving),
            microscope=scope,
            background=_FIELD * share,
            target=replace(case.target, bright=False),
        )
    if kind == "line":
        lit = replace(lit, moving=tuple(_rounded(layer) for layer in lit.moving))
    return replace(lit, ring=_RING)


def _solid(layer: Layer) -> Layer:
    return replace(layer, underside_um=layer.z_um - _THICK_UM)


def _rounded(layer: Layer) -> Layer:
    """Return a layer with lines, of a finer rounding where its walls are thin."""
    for radius_um in (_ROUND_UM, _FINE_UM):
        line = edge_line(
            _RING,
            mirrored=_FINISH * layer.reflectance,
            radius_um=radius_um,
            rings=len(layer.outline.rings),
        )
        dull = replace(
            layer, reflectance=(1 - _FINISH) * layer.reflectance, edge_line=line
        )
        try:
            line_layer(dull, 0.5)
        except ValueError:
            continue
        return dull
    return layer


def _outside_less_inside(
    case: LookCase, at_px: FloatArray, normal: FloatArray
) -> FloatArray:
    """Return how much brighter rays find the outside of edges, (N,)."""
    points = np.array([case.frame.to_world(*at) for at in at_px.tolist()])
    out = normal * (1.0, -1.0)
    found, error = _told(case, points, out, _RAYS)
    for more in range(_ROUNDS):
        open_ = np.flatnonzero(np.abs(found) < _SURE * error)
        for k in open_:
            rays = _RAYS * _MORE ** (more + 1)
            found[[k]], error[[k]] = _told(case, points[[k]], out[[k]], rays)
    return found


def _told(
    case: LookCase, points: FloatArray, out: FloatArray, rays: int
) -> tuple[FloatArray, FloatArray]:
    """Return how much brighter so many rays find the outside, and standard errors."""
    scope = case.microscope
    rng = np.random.default_rng(5)
    spread = _AIRY * scope.airy_radius_um * rng.standard_normal((rays, 2))
    spread += scope.um_per_px * rng.uniform(-0.5, 0.5, (rays, 2))
    apart_um = _ASIDE * scope.airy_radius_um
    means, errors = [], []
    for aside_um in (apart_um, -max(apart_um, _line_um(case))):
        middle = points + aside_um * out
        all_of = (middle[:, None] + spread).reshape(-1, 2)
        values = _seen(case, all_of).reshape(len(points), rays)
        means.append(values.mean(axis=1))
        errors.append(values.std(axis=1) / math.sqrt(rays))
    return means[0] - means[1], np.hypot(*errors)


def _seen(case: LookCase, points_um: FloatArray) -> FloatArray:
    """Return what one ray finds through each point of the plane in focus, (N,)."""
    layers = scene(case, 0.0, 0.0, 0.0).layers
    prisms = [
        SharpPrism(
            polygon=sharp_polygon(layer.outline),
            low_um=layer.z_um - _THICK_UM,
            top_um=layer.z_um,
            sends=layer.reflectance,
            lines=_line_of(layer),
        )
        for layer in layers
    ]
    if case.ring is None:
        return seen_from_below(
            points_um,
            prisms,
            focus_um=case.focus_um,
            aperture=case.microscope.aperture,
            lamp_aperture=_LAMP,
            field=_FIELD,
            rays=1,
        )
    return seen_under_ring(
        points_um,
        prisms,
        focus_um=case.focus_um,
        aperture=case.microscope.aperture,
        elevation_rad=(case.ring.low_rad, case.ring.high_rad),
        floor_um=_FLOOR_UM,
        floor=case.background,
        rays=1,
        to_ring=_TO_RING,
    )


def _line_um(case: LookCase) -> float:
    """Return how far inside edges the target's lines have their middle, um."""
    lines = [line for la in case.moving if (line := la.edge_line) is not None]
    return max((line.radius_um / 2 for line in lines), default=0.0)


def _line_of(layer: Layer) -> tuple[float, float, float] | None:
    """Return a line's level and the distances inside the edge that it lies between."""
    line = layer.edge_line
    if line is None:
        return None
    outer_um = (line.radius_um - line.width_um) / 2
    return (line.level, outer_um, outer_um + line.width_um)
