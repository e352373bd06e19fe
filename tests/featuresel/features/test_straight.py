"""Calipers on one edge, on a pair and on a corner of rendered parts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.featuresel.features.contour import with_contour
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    Measurement,
    TargetKind,
)
from microplan.featuresel.routines.registry import load
from microplan.optics.outline.outline import Outline, Ring, Segment, place
from microplan.optics.render.scene import Illumination

Look = Callable[[str], LookCase]
Expose = Callable[[LookCase, FloatArray, np.random.Generator], FloatArray]

ROUTINES: dict[TargetKind, str] = {
    "edge": "line_caliper",
    "pair": "edge_pair",
    "corner": "corner",
}


def block(*points: tuple[float, float]) -> Outline:
    ends = points[1:] + points[:1]
    edges = tuple(Segment(start=a, end=b) for a, b in zip(points, ends, strict=True))
    return Outline(rings=(Ring(edges=edges),))


def feature(look: Look, kind: TargetKind, *, theta_rad: float = 0.3) -> LookCase:
    """Return a look at a 70 x 30 um block's long side, both of them, or a corner."""
    whole = block((-15, -35), (15, -35), (15, 35), (-15, 35))
    shown, parameters = {
        "edge": (place(whole, -15.0, 0.0), {"length_um": 70.0}),
        "pair": (whole, {"length_um": 70.0, "width_um": 30.0}),
        # the corner's bisector turned from 45 degrees to the x axis
        "corner": (
            place(place(whole, -15.0, -35.0), 0.0, 0.0, -math.pi / 4),
            {"angle_rad": math.pi / 2, "reach_um": 28.0},
        ),
    }[kind]
    case = look("bracket")
    moving = (replace(case.moving[0], outline=shown),)
    target = replace(
        case.target,
        kind=kind,
        theta_rad=theta_rad,
        theta_range_rad=0.26,
        parameters=parameters,
    )
    found = replace(case, moving=moving, theta_rad=theta_rad, theta_any=False)
    return replace(found, target=with_contour(target, [shown]))


def prepared(case: LookCase) -> Artifact:
    found = load(ROUTINES[case.target.kind]).prepare(nominal_render(case), case.target)
    assert isinstance(found, Artifact), found
    return found


def measure(
    case: LookCase, image: FloatArray, artifact: Artifact
) -> Measurement | Failure:
    start = Guess(column=case.target.column, row=case.target.row)
    return load(ROUTINES[case.target.kind]).measure(image, artifact, start)


@dataclass(frozen=True)
class Errors:
    """Of one measurement: along the axis that is known, or both; um and rad."""

    place_um: tuple[float, ...]
    turn_rad: float
    spread_um: float


def errors(
    case: LookCase, found: Measurement, dx: float, dy: float, turn: float
) -> Errors:
    x, y = case.frame.to_world(found.column, found.row)
    off = (x - case.x_um - dx, y - case.y_um - dy)
    if found.axis_rad is not None:
        off_axis = off[0] * math.cos(found.axis_rad) + off[1] * math.sin(found.axis_rad)
        off = (off_axis,)  # type: ignore[assignment]
    assert found.theta_rad is not None
    return Errors(
        place_um=off,
        turn_rad=found.theta_rad - case.theta_rad - turn,
        spread_um=found.spread_px * case.microscope.um_per_px,
    )


@pytest.mark.parametrize("kind", ["edge", "pair", "corner"])
@pytest.mark.parametrize("focus_um", [0.0, 12.0])
def test_errors_are_within_the_pixel_locking_of_straight_edges(
    kind: TargetKind, focus_um: float, look: Look, expose_image: Expose
) -> None:
    case = replace(feature(look, kind), focus_um=focus_um)
    artifact, render = prepared(case), nominal_render(case)
    rng = np.random.default_rng(3)
    found = []
    for _ in range(8):
        dx, dy, turn = (*rng.uniform(-5, 5, 2), rng.uniform(-0.2, 0.2))
        image = expose_image(case, render(dx_um=dx, dy_um=dy, theta_rad=turn), rng)
        one = measure(case, image, artifact)
        assert isinstance(one, Measurement), one
        found.append(errors(case, one, dx, dy, turn))
    places = np.array([one.place_um for one in found])
    assert places.shape[1] == (2 if kind == "corner" else 1)
    # edges along pixel rows sample one phase only: no more than .05 px, beside noise
    spread = max(one.spread_um for one in found)
    assert np.abs(places).max() < max(0.05 / case.target.px_per_um, 3.5 * spread)
    # of which the far end of a stretch may have one and the near end the other
    assert max(abs(one.turn_rad) for one in found) < 2 * 0.05 / 20
    assert np.sqrt((places**2).mean()) < 2 * np.mean([one.spread_um for one in found])


@pytest.mark.parametrize("kind", ["edge", "pair", "corner"])
def test_light_focus_and_zoom_errors_stay_small(
    kind: TargetKind, look: Look, expose_image: Expose
) -> None:
    case = feature(look, kind)
    artifact, rng = prepared(case), np.random.default_rng(4)
    for gain, gradient, dz, zoom in ((0.7, 0.3, 6.0, 1.01), (1.2, -0.3, -6.0, 0.99)):
        light = Illumination(gain=gain, gradient_x=gradient)
        seen = replace(case, light=light)
        image = nominal_render(seen)(
            dx_um=3.0, dy_um=2.0, theta_rad=-0.1, dz_um=dz, zoom=zoom
        )
        found = measure(case, expose_image(case, image, rng), artifact)
        assert isinstance(found, Measurement), found
        off = errors(case, found, 3.0, 2.0, -0.1)
        # 6 um from focus the corner of the blur is 30 um along the legs; the zoom
        # moves what is 4 um off the axis by .04 um
        assert np.abs(off.place_um).max() < 0.3
        assert abs(off.turn_rad) < 0.01


def test_the_middle_of_a_pair_does_not_feel_its_width(look: Look) -> None:
    case = feature(look, "pair")
    artifact = prepared(case)
    wide = block((-15.4, -35), (15.4, -35), (15.4, 35), (-15.4, 35))
    other = replace(case, moving=(replace(case.moving[0], outline=wide),))
    found = measure(case, nominal_render(other)(dx_um=2.0), artifact)
    assert isinstance(found, Measurement)
    assert abs(errors(case, found, 2.0, 0.0, 0.0).place_um[0]) < 0.05
    far = block((-17, -35), (17, -35), (17, 35), (-17, 35))
    other = replace(case, moving=(replace(case.moving[0], outline=far),))
    found = measure(case, nominal_render(other)(), artifact)
    assert isinstance(found, Failure)
    assert found.code == "width_off"


def test_a_dark_part_is_found_as_well(look: Look) -> None:
    for kind in ROUTINES:
        case = feature(look, kind)
        dark = replace(
            case,
            background=0.8,
            moving=(replace(case.moving[0], reflectance=0.2),),
        )
        image = nominal_render(dark)(dx_um=3.0, theta_rad=0.1)
        found = measure(dark, image, prepared(dark))
        assert isinstance(found, Measurement)
        off = errors(dark, found, 3.0, 0.0, 0.1)
        assert np.abs(off.place_um).max() < 0.05 / 0.92
        # a bright one instead is something else
        assert isinstance(measure(case, image, prepared(case)), Failure)


def test_edges_like_it_nearby_are_ambiguous(look: Look) -> None:
    case = feature(look, "edge")
    # a second block 8 um farther, whose sides are as long
    blocks = [block((-30, -35), (0, -35), (0, 35), (-30, 35))]
    blocks.append(block((3, -35), (8, -35), (8, 35), (3, 35)))
    both = Outline(rings=tuple(ring for one in blocks for ring in one.rings))
    twice = replace(case, moving=(replace(case.moving[0], outline=both),))
    found = load("line_caliper").prepare(nominal_render(twice), twice.target)
    assert isinstance(found, Failure)
    assert found.code == "ambiguous"


@pytest.mark.parametrize("kind", ["edge", "pair", "corner"])
def test_what_shows_no_such_edges_is_refused(
    kind: TargetKind, look: Look, expose_image: Expose
) -> None:
    case, rng = feature(look, kind), np.random.default_rng(6)
    artifact = prepared(case)
    shape = (case.window.rows, case.window.columns)
    images = [
        *(expose_image(case, np.full(shape, v), rng) for v in (0.0, 0.1, 0.7, 1.0)),
        rng.random(shape),
        np.zeros((1, 1)),
        rng.random((3, 9)),
        nominal_render(look("post"))(),
    ]
    for image in images:
        before = image.copy()
        assert isinstance(measure(case, image, artifact), Failure)
        np.testing.assert_array_equal(image, before)


def test_what_cannot_be_prepared_says_why(look: Look) -> None:
    edge, corner = feature(look, "edge"), feature(look, "corner")
    free = replace(edge.target, theta_range_rad=math.pi)
    flat = replace(corner.target, parameters={"angle_rad": 3.1, "reach_um": 28.0})
    aside = replace(edge.target, column=-30.0)
    dull = replace(edge, moving=(replace(edge.moving[0], reflectance=0.11),))
    for case, target, code in (
        (edge, free, "range"),
        (corner, flat, "flat"),
        (edge, aside, "no_edge"),
        (dull, dull.target, "no_edge"),
    ):
        routine = load(ROUTINES[target.kind])
        found = routine.prepare(nominal_render(case), target)
        assert isinstance(found, Failure)
        assert found.code == code
