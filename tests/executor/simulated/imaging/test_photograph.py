"""Photographs: uniform fields, turned scenes, rays followed one by one."""

from __future__ import annotations

import gc
import math
import weakref
from dataclasses import replace

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.executor.simulated.imaging.imaging_view import (
    LampLevel,
    PixelWindow,
    RaySampling,
    TrueLensErrors,
)
from microplan.executor.simulated.imaging.photograph import (
    KEPT,
    PhotographedScene,
    photograph,
)
from microplan.executor.simulated.imaging.solids.solid_scene import SolidBody
from microplan.schemas.pose import Pose
from tests.executor.simulated.imaging.bodies import (
    APERTURE,
    STAGE,
    Ring,
    body,
    box,
    circle,
    scene,
    twin,
    view,
)
from tests.executor.simulated.imaging.plain_rays import seen

SMALL = PixelWindow(row=230, column=310, rows=20, columns=20)
POST: list[Ring] = [circle(0, 0, 22)]
GEAR: list[Ring] = [circle(1, 0.5, 50), circle(1, 0.5, 25)]
LEFT: list[Ring] = [box(-150, -60, -50, 500)]
RIGHT: list[Ring] = [box(50, -60, 150, 500)]


def over_shaft(wall: float, finish: float) -> list[tuple[SolidBody, list[Ring]]]:
    """Return a post seen through a bore 110 um above it, between two fingers."""
    made = [(POST, 0.0, 250.0, 0.75), (GEAR, 260.0, 360.0, 0.8),
            (LEFT, 300.0, 500.0, 0.7), (RIGHT, 300.0, 500.0, 0.7)]  # fmt: skip
    return [(body(r, a, b, c, wall=wall, finish=finish), r) for r, a, b, c in made]


def seated(wall: float, finish: float) -> list[tuple[SolidBody, list[Ring]]]:
    """Return a gear round a post that stands 150 um above it."""
    made = [(POST, 0.0, 250.0, 0.75), (GEAR, 0.0, 100.0, 0.8)]
    return [(body(r, a, b, c, wall=wall, finish=finish), r) for r, a, b, c in made]


@pytest.mark.parametrize("focus_um", [0.0, 5.0, 300.0])
@pytest.mark.parametrize("lamp", [0.0, 0.5, 1.0])
def test_a_bare_stage_is_as_bright_as_it_reflects(focus_um: float, lamp: float) -> None:
    image = photograph(scene(), view(6.9, focus_um, lamp=lamp), SMALL)
    np.testing.assert_allclose(image, STAGE, atol=1e-6)


@pytest.mark.parametrize("finish", [0.0, 0.4, 1.0])
def test_a_wide_face_is_as_bright_as_it_reflects(finish: float) -> None:
    plate = body([box(-300, -300, 300, 300)], 0.0, 40.0, 0.6, finish=finish)
    for focus_um in (40.0, 46.0, 130.0):
        image = photograph(scene(plate), view(6.9, focus_um), SMALL)
        # the borders are 290 um off: their diffraction sends less than 1e-3
        np.testing.assert_allclose(image, 0.6, atol=1e-3)


def test_light_and_gradient_scale_the_picture() -> None:
    lamp = LampLevel(level=0.5, gradient_x=0.2, gradient_y=-0.1)
    image = photograph(scene(), replace(view(6.9, 0.0), lamp=lamp), SMALL)
    column, row = 310 - 319.5, 230 - 239.5
    wanted = STAGE * 0.5 * (1 + 0.2 * column / 640 - 0.1 * -row / 480)
    assert image[0, 0] == pytest.approx(wanted, abs=1e-6)


def test_a_scene_turned_by_a_quarter_is_a_picture_turned() -> None:
    """No direction is another one: outlines, lattices and pupil keep to no axis."""
    rings: list[Ring] = [circle(3, 0, 20), circle(6, 2, 8)]
    window = PixelWindow(row=210, column=290, rows=60, columns=60)
    images = []
    for quarter in (0, 1):
        pose = Pose(x_um=0.0, y_um=0.0, theta_rad=quarter * math.pi / 2)
        found = scene(body(rings, 0.0, 60.0, pose=pose))
        # the pattern of the pupil turns with the scene
        sampling = RaySampling(turn_rad=quarter * math.pi / 2)
        images.append(photograph(found, view(6.9, 63.0), window, sampling=sampling))
    # a body's map is not turned with it: a cell of .2 um on slopes over 9 um
    np.testing.assert_allclose(images[1], np.rot90(images[0]), atol=2e-3)


@pytest.mark.parametrize(
    ("wall", "finish", "drop_um"), [(0.0, 0.0, 0.0), (0.6, 0.0, 6.0), (0.6, 1.0, 0.0)]
)
@pytest.mark.parametrize("look", ["over_shaft", "seated"])
def test_points_away_from_edges_are_what_single_rays_say(
    look: str, wall: float, finish: float, drop_um: float
) -> None:
    if look == "over_shaft":
        made, focus_um = over_shaft(wall, finish), 250.0 + drop_um
        x, y = 12.0, 5.0
    else:
        made, focus_um = seated(wall, finish), 100.0 + drop_um
        x, y = 0.0, 39.0
    found = view(20.0, focus_um, fill=1e-6)
    column, row = round(319.5 + x * found.px_per_um), round(239.5 - y * found.px_per_um)
    at = ((column - 319.5) / found.px_per_um, (239.5 - row) / found.px_per_um)
    window = PixelWindow(row=row - 1, column=column - 1, rows=3, columns=3)
    image = photograph(scene(*(b for b, _ in made)), found, window)
    plain = [twin(b, rings) for b, rings in made]
    wanted = seen(plain, (*at, focus_um), APERTURE, STAGE, rays=160, lamp=25, share=1.0)
    # 160 rays at random angles on even rings: .02 of a share; waves from an edge 10 um
    # off: lambda / (2 pi**2 A 10 um) = .007 of its step
    assert image[1, 1] == pytest.approx(wanted, abs=0.02)


def test_another_pattern_of_rays_makes_the_same_picture() -> None:
    found = scene(*(b for b, _ in over_shaft(0.0, 0.0)))
    window = PixelWindow(row=220, column=300, rows=40, columns=40)
    images = [
        photograph(
            found, view(6.9, 250.0), window,
            sampling=RaySampling(rays=500, lamp_rays=300, turn_rad=turn),
        )
        for turn in (0.0, 1.0)
    ]  # fmt: skip
    difference = images[1] - images[0]
    assert np.sqrt(np.mean(difference**2)) < 0.002  # .0014 of each
    assert np.abs(difference).max() < 0.006


def test_pictures_do_not_depend_on_those_before() -> None:
    found = scene(*(b for b, _ in seated(0.0, 0.0)))
    window = PixelWindow(row=215, column=300, rows=8, columns=8)

    def taken(focus_um: float) -> FloatArray:
        return photograph(found, view(6.9, focus_um), window)

    for other_um in (104.0, 100.0):
        taken(other_um)
    after = taken(102.0)
    for stage in range(KEPT):  # what was kept of the scene is forgotten
        photograph(scene(stage=0.01 * stage), view(6.9, 0.0), SMALL)
    np.testing.assert_array_equal(taken(102.0), after)


def test_a_scene_that_is_not_kept_is_freed_at_once() -> None:
    """Its arrays, up to a GiB, must not wait for the collector of circles."""
    made: list[weakref.ref[PhotographedScene]] = []

    class Noted(PhotographedScene):
        def __init__(self, *arguments: object) -> None:
            super().__init__(*arguments)  # type: ignore[arg-type]
            made.append(weakref.ref(self))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "microplan.executor.simulated.imaging.photograph.PhotographedScene", Noted
        )
        gc.collect()
        gc.disable()
        try:
            for k in range(KEPT + 2):
                post = body(POST, 0.0, 10.0 + k, wall=0.5, finish=0.5)
                photograph(scene(post), view(6.9, 0.0), SMALL)
            held = [ref() is not None for ref in made]
        finally:
            gc.enable()
    assert held == [False] * 2 + [True] * KEPT


def test_a_point_moves_as_the_lens_errs() -> None:
    """A small disc off the axis, in and out of focus, with every error at once."""
    errors = TrueLensErrors(
        distortion=0.02, lateral_x=0.03, lateral_y=-0.02, scale_per_um=2e-4
    )
    x, y, top = 200.0, 100.0, 30.0
    disc = body([circle(x, y, 6.0)], 0.0, top, 0.9)
    focus_um = 20.0
    found = replace(view(6.9, focus_um), errors=errors, shift_um=(1.5, -0.7))
    z = top - focus_um
    ix, iy = (1 + 2e-4 * z) * x + 0.03 * z, (1 + 2e-4 * z) * y - 0.02 * z
    grown = 1 + 0.02 * (ix**2 + iy**2) / found.half_diagonal_um**2
    ix, iy = ix * grown + 1.5, iy * grown - 0.7
    column, row = 319.5 + ix * found.px_per_um, 239.5 - iy * found.px_per_um
    window = PixelWindow(
        row=round(row) - 20, column=round(column) - 20, rows=41, columns=41
    )
    light = photograph(scene(disc, stage=0.0), found, window)
    down, across = np.mgrid[0:41, 0:41]
    centre = (
        window.column + (light * across).sum() / light.sum(),
        window.row + (light * down).sum() / light.sum(),
    )
    # the disc's outer side is stretched more: d r (3 w**2 / 2) / H**2 = .002 px
    assert centre == pytest.approx((column, row), abs=0.02)


def test_a_curved_field_focuses_higher_off_the_axis() -> None:
    x = 250.0
    disc = body([box(x - 30, -30, x, 30)], 0.0, 30.0, 0.9)
    curvature = 2 * 8.0 / x**2  # 8 um higher there
    slopes = []
    for focus_um, errors in (
        (30.0, TrueLensErrors()),
        (22.0, TrueLensErrors(field_curvature_per_um=curvature)),
        (30.0, TrueLensErrors(field_curvature_per_um=curvature)),
    ):
        found = replace(view(6.9, focus_um), errors=errors)
        column = round(319.5 + x * found.px_per_um)
        window = PixelWindow(row=236, column=column - 8, rows=8, columns=17)
        slopes.append(np.abs(np.diff(photograph(scene(disc), found, window))).max())
    assert slopes[1] == pytest.approx(slopes[0], rel=0.03)
    assert slopes[2] < 0.6 * slopes[0]
