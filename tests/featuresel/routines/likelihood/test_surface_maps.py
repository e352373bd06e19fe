"""Walls and faces that are not known: what they change, and what a fit makes of it."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.unknown_surfaces import (
    UnknownSurface,
    drawn_surfaces,
)
from microplan.featuresel.routines.contract import Artifact
from microplan.featuresel.routines.likelihood.appearance import ImagePose, OccluderBlur
from microplan.featuresel.routines.likelihood.comparison import DefocusedImage
from microplan.featuresel.routines.likelihood.fit_problem import prepare_job, read_job
from microplan.featuresel.routines.likelihood.foreground import Front
from microplan.featuresel.routines.likelihood.pose_fit import (
    PoseFit,
    fit_pose,
    surfaces_first,
)
from microplan.featuresel.routines.likelihood.surface_maps import surface_maps
from microplan.optics.render.scene import Window
from tests.featuresel import fits
from tests.featuresel.conftest import on_target

HALF_PX = 32
POSE_SIGMA_UM = 1.5


@cache
def over_shaft() -> LookCase:
    """Return the post down the bore in coaxial light, faces dull or mirrors."""
    case = fits.case("over_shaft")
    side = 2 * HALF_PX
    window = Window(row=240 - HALF_PX, column=320 - HALF_PX, rows=side, columns=side)
    still = replace(case.spread, focus_sigma_um=0.0, magnification_sigma=0.0,
                    pose_sigma_xy_um=POSE_SIGMA_UM)  # fmt: skip
    surfaces = tuple(
        UnknownSurface(
            layer=layer.name,
            body=layer.name,
            underside_um=None,
            wall=(0.0, 0.9),
            finish=(0.0, 1.0),
        )
        for layer in (*case.static, *case.moving)
    )
    return on_target(
        replace(
            case, window=window, spread=still, lamp_aperture=0.42, surfaces=surfaces
        )
    )


def shown(mirror: float, x_um: float, y_um: float) -> FloatArray:
    """Return the image with faces so much of mirrors, by the renderer itself."""
    case = over_shaft()
    faces = tuple(replace(s, finish=(0.0, mirror)) for s in case.surfaces)
    static, moving = (
        drawn_surfaces(layers, faces, {face.body: (None, 1.0) for face in faces})
        for layers in (case.static, case.moving)
    )
    render = nominal_render(replace(case, static=static, moving=moving))
    return render(dx_um=x_um, dy_um=y_um)


@cache
def prepared() -> Artifact:
    case = over_shaft()
    made = prepare_job(nominal_render(case), case.target)
    assert isinstance(made, Artifact), made
    return made


def test_surfaces_that_are_known_change_nothing() -> None:
    case = replace(over_shaft(), surfaces=())
    render = nominal_render(case)
    assert render.surface_changes() == ()
    assert surface_maps(render, case.target, render()) is None


def test_maps_show_a_face_in_between_at_places_they_were_not_made_from() -> None:
    # A tenth of the camera's noise in the mean: .005 at a quarter of full scale.
    case = over_shaft()
    render = nominal_render(case)
    maps = surface_maps(render, case.target, render())
    assert maps is not None
    assert len(maps.light) == 1  # walls that no body has are left out
    for x, y in ((0.0, 0.0), (1.1, -0.7), (-2.3, 1.2)):
        change = shown(0.4, x, y) - shown(0.0, x, y)
        found = maps.light[0] + maps.through[0] * render.alone(dx_um=x, dy_um=y)
        assert np.abs(change).max() > 0.03
        assert np.sqrt(np.mean((0.4 * found - change) ** 2)) < 5e-4


@pytest.mark.parametrize("mirror", [0.0, 1.0])
def test_a_fit_that_knows_of_mirrors_is_not_drawn_by_them(mirror: float) -> None:
    case, at_um = over_shaft(), (1.3, -0.6)
    image = shown(mirror, *at_um)
    job = read_job((DefocusedImage(image=image),), prepared())
    column, row = case.frame.to_pixel(case.x_um + at_um[0], case.y_um + at_um[1])
    start = ImagePose(
        column=column + 0.4, row=row - 0.3, turn_rad=0.0, z_um=0.0, zoom=1.0
    )
    found = fit_pose(job, surfaces_first(job, start))
    assert isinstance(found, PoseFit)
    off = math.hypot(found.pose.column - column, found.pose.row - row)
    assert off < 0.02  # a hundredth of what the camera resolves
    assert found.pose.occluder_blur.occluder_modes[-1] == pytest.approx(
        mirror, abs=0.05
    )


def test_slopes_by_amounts_and_place_are_differences() -> None:
    rng = np.random.default_rng(5)
    side, modes, surfaces = 12, 3, 2
    maps = rng.random((6, side, side)).astype(np.float32)
    front = Front(
        light=maps, through=maps, core_light=maps, core_through=maps, reach_um=9.0,
        axis_px=(6.0, 6.0),
        mode_light=rng.random((modes, side, side)).astype(np.float32),
        mode_through=rng.random((modes, side, side)).astype(np.float32),
        mode_moved=rng.random((surfaces, 2, side, side)).astype(np.float32),
        place_px=(5.0, 7.0), far_px=3.0,
    )  # fmt: skip
    rows, columns = (places.ravel() for places in np.mgrid[:side, :side])
    amounts = np.array([0.3, -0.8, 1.2])
    pose = ImagePose(
        column=5.9, row=6.2, turn_rad=0.0, z_um=0.0, zoom=1.0,
        front=OccluderBlur(focus_um=1.0, occluder_modes=tuple(amounts.tolist())),
    )  # fmt: skip
    here = front.at(pose, columns, rows)
    # all is linear: differences are the slopes but for 32 bits
    for k in range(modes):
        more = tuple((amounts + np.eye(modes)[k]).tolist())
        blur = OccluderBlur(focus_um=1.0, occluder_modes=more)
        there = front.at(replace(pose, front=blur), columns, rows)
        np.testing.assert_allclose(
            there.light - here.light, here.light_slopes[2 + k], atol=1e-5
        )
    for k, moved in enumerate(
        (replace(pose, column=pose.column + 1), replace(pose, row=pose.row + 1))
    ):
        there = front.at(moved, columns, rows)
        np.testing.assert_allclose(
            there.light - here.light, here.by_place[k], atol=1e-5
        )
    # twice as far as is known nothing is left of surfaces
    gone = front.at(replace(pose, column=11.0), columns, rows)
    none = replace(pose.occluder_blur, occluder_modes=(0.3, 0.0, 0.0))
    plain = front.at(replace(pose, front=none), columns, rows)
    np.testing.assert_allclose(gone.light, plain.light, atol=1e-6)
