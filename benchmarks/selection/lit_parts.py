"""Random parts in light from below and from a ring, judged ray by ray.

The prediction is what routines are prepared with; the truth follows single rays through
sharp prisms (`tests/optics/light/sharp_rays.py`), with points spread over a pixel and
over the lens' Airy pattern, by which the sides lie off an edge. Roundings are mirrors,
each a quarter of an ellipse of another steepness: where their lines lie and how bright
they are, is not predicted. A bright line is compared with the outside of its edge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import j0, j1

from benchmarks.selection.random_parts import random_case
from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase, scene
from microplan.featuresel.routines.contour.polarity import place, predict
from microplan.optics.light.lamps import RingLamp, edge_line
from microplan.optics.light.mirrored_strip import mirrored_strip
from microplan.optics.light.ring import line_layer
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Microscope
from tests.optics.light.sharp_rays import (
    SharpPrism,
    SharpRounding,
    seen_from_below,
    seen_under_ring,
    sharp_polygon,
)

KINDS = ("transmitted", "ring", "line", "high_ring", "high_line")
POINTS = 24  # kept edges of a part that are judged
_THICK_UM, _FLOOR_UM = 20.0, -90.0
_LAMP, _FIELD = 0.3, 0.9
_RING = RingLamp(low_rad=math.radians(20), high_rad=math.radians(45))
_HIGH_RING = RingLamp(low_rad=math.radians(40), high_rad=math.radians(60))
_SINE = 0.42  # of the lens' half angle
_FINISH, _ROUND_UM, _FINE_UM = 0.6, 2.0, 0.3
_NEAR = 1 / 6  # of the focus that parts in front light have: edges stay apart
_RAYS, _TO_RING = 400, 12
_MORE, _ROUNDS = 16, 2  # times as many rays for sides that are not told apart by
_SURE = 4.0  # standard errors
_ASIDE = 1.0  # of the Airy radius, where an edge's sides are compared
_STEEPEST = 2.0  # height of a rounding over its width, or the inverse
_RINGS = 100.0  # optical units of the Airy pattern that points lie in: .6 % do not


def judged(kind: str, seed: tuple[int, int]) -> tuple[int, int, int]:
    """Return points, kept points and, of `POINTS` of those, wrong ones of one part."""
    case = lit_case(random_case(np.random.default_rng(seed)), kind)
    found = predict(nominal_render(case), case.target)
    kept = np.flatnonzero(found.kept)
    if not len(kept):
        return len(found.kept), 0, 0
    some = kept[:: max(1, math.ceil(len(kept) / POINTS))]
    where = place(np.array(case.target.contour), case.target)[some]
    steepness = float(_STEEPEST ** np.random.default_rng((*seed, 1)).uniform(-1, 1))
    brighter = _outside_less_inside(case, where[:, :2], where[:, 2:], steepness)
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
    ring = _HIGH_RING if kind.startswith("high_") else _RING
    if kind.endswith("line"):
        moving = tuple(_rounded(layer, ring) for layer in lit.moving)
        lit = replace(lit, moving=moving)
    return replace(lit, ring=ring)


def _solid(layer: Layer) -> Layer:
    return replace(layer, underside_um=layer.z_um - _THICK_UM)


def _rounded(layer: Layer, ring: RingLamp) -> Layer:
    """Return a layer with lines, of a finer rounding where its walls are thin."""
    for radius_um in (_ROUND_UM, _FINE_UM):
        line = edge_line(
            ring,
            mirrored=_FINISH * layer.reflectance,
            radius_um=radius_um,
            rings=len(layer.outline.rings),
        )
        dull = replace(
            layer, reflectance=(1 - _FINISH) * layer.reflectance, edge_line=line
        )
        try:
            line_layer(dull, 1.0, mirrored_strip(ring, _SINE))
        except ValueError:
            continue
        return dull
    return layer


def _outside_less_inside(
    case: LookCase, at_px: FloatArray, normal: FloatArray, steepness: float
) -> FloatArray:
    """Return how much brighter rays find the outside of edges, (N,)."""
    points = np.array([case.frame.to_world(*at) for at in at_px.tolist()])
    out = normal * (1.0, -1.0)
    bodies = _prisms(case, steepness)
    found, error = _told(case, bodies, points, out, _RAYS)
    for more in range(_ROUNDS):
        open_ = np.flatnonzero(np.abs(found) < _SURE * error)
        for k in open_:
            rays = _RAYS * _MORE ** (more + 1)
            one = points[[k]], out[[k]]
            found[[k]], error[[k]] = _told(case, bodies, *one, rays)
    return found


def _told(
    case: LookCase,
    bodies: Sequence[SharpPrism],
    points: FloatArray,
    out: FloatArray,
    rays: int,
) -> tuple[FloatArray, FloatArray]:
    """Return how much brighter so many rays find the outside, and standard errors."""
    scope = case.microscope
    rng = np.random.default_rng(5)
    spread = _airy(scope, rays, rng)
    spread += scope.um_per_px * rng.uniform(-0.5, 0.5, (rays, 2))
    apart_um = _ASIDE * scope.airy_radius_um
    means, errors = [], []
    for aside_um in (apart_um, -max(apart_um, _line_um(case, bodies))):
        middle = points + aside_um * out
        all_of = (middle[:, None] + spread).reshape(-1, 2)
        values = _seen(case, bodies, all_of).reshape(len(points), rays)
        means.append(values.mean(axis=1))
        errors.append(values.std(axis=1) / math.sqrt(rays))
    return means[0] - means[1], np.hypot(*errors)


def _airy(scope: Microscope, count: int, rng: np.random.Generator) -> FloatArray:
    """Return points spread as the light of a point in focus, (count, 2) um.

    Within v optical units lies 1 - J0(v)^2 - J1(v)^2 of it (Rayleigh).
    """
    v = np.linspace(0, _RINGS, 20_001)
    within = 1 - j0(v) ** 2 - j1(v) ** 2
    radius = np.interp(rng.uniform(0, within[-1], count), within, v)
    radius *= scope.wavelength_um / (2 * math.pi * scope.aperture)
    angle = rng.uniform(0, 2 * math.pi, count)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def _prisms(case: LookCase, steepness: float) -> list[SharpPrism]:
    """Return a look's bodies for rays, their roundings of one steepness."""
    return [
        SharpPrism(
            polygon=sharp_polygon(layer.outline),
            low_um=layer.z_um - _THICK_UM,
            top_um=layer.z_um,
            sends=layer.reflectance,
            rounding=None
            if layer.edge_line is None
            else SharpRounding(
                level=layer.edge_line.level,
                radius_um=layer.edge_line.radius_um,
                steepness=steepness,
            ),
        )
        for layer in scene(case, 0.0, 0.0, 0.0).layers
    ]


def _seen(
    case: LookCase, bodies: Sequence[SharpPrism], points_um: FloatArray
) -> FloatArray:
    """Return what one ray finds through each point of the plane in focus, (N,)."""
    if case.ring is None:
        return seen_from_below(
            points_um,
            bodies,
            focus_um=case.focus_um,
            aperture=case.microscope.aperture,
            lamp_aperture=_LAMP,
            field=_FIELD,
            rays=1,
        )
    return seen_under_ring(
        points_um,
        bodies,
        focus_um=case.focus_um,
        aperture=case.microscope.aperture,
        elevation_rad=(case.ring.low_rad, case.ring.high_rad),
        floor_um=_FLOOR_UM,
        floor=case.background,
        rays=1,
        to_ring=_TO_RING,
    )


def _line_um(case: LookCase, bodies: Sequence[SharpPrism]) -> float:
    """Return how far inside edges the target's lines have their middle, um."""
    if case.ring is None:
        return 0.0
    tilt_rad = (math.pi / 2 - (case.ring.low_rad + case.ring.high_rad) / 2) / 2
    found = [body.rounding for body in bodies if body.rounding is not None]
    return max((each.inward_um(tilt_rad) for each in found), default=0.0)
