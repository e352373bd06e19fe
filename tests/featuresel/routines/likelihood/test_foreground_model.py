from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest
from scipy.ndimage import map_coordinates

from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.routines.likelihood.appearance import ImagePose, OccluderBlur
from microplan.featuresel.routines.likelihood.foreground import Front
from microplan.featuresel.routines.likelihood.front_maps import front_maps
from microplan.featuresel.routines.likelihood.joint_blur import JointBlur
from microplan.optics.outline.outline import place
from tests.featuresel.fits import Drawn, artifact, case, job, render

REACH_UM = 12.0  # three deviations of the focus
IMAGE = 1e-6  # that outlines transformed in single precision cost an image
# A slope S(off shown) / (S off^2 + n d^2) of n images, each off by IMAGE, errs by up to
# IMAGE / 2 d: d is `front_maps._DOUBT`. Elsewhere it acts on all of the target's step.
SLOPE = IMAGE / (2 * 0.02)
# A spline between heights and parabolas between places leave so much of what bodies
# hide together; the product leaves all of it.
LEFT = 0.1


def front(name: str) -> Front:
    """Return what a prepared fit holds, in 32 bits: good to 1e-7."""
    found = job(name, render(name)()).front
    assert found is not None
    return found


def grid(name: str) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    rows, columns = np.mgrid[: case(name).window.rows, : case(name).window.columns]
    return columns.ravel(), rows.ravel()


@pytest.mark.parametrize("name", ["find_gear", "post", "bore"])
def test_what_stands_alone_has_nothing_before_it(name: str) -> None:
    assert front_maps(render(name), case(name).target, render(name)(), 12.0) is None


@pytest.mark.parametrize("name", ["between", "over_shaft"])
@pytest.mark.parametrize(
    ("z_um", "zoom"), [(0, 1), (-5, 1), (12, 1), (15, 1), (0, 0.995)]
)
def test_images_are_the_target_alone_behind_a_veil(
    name: str, z_um: float, zoom: float
) -> None:
    # at places that the maps were not made from, to a tenth of the camera's noise;
    # in focus exact but for lines between pixels, out of it but for the rays' pattern
    scope = case(name).microscope
    zoomed = replace(scope, magnification=scope.magnification * zoom)
    look = nominal_render(replace(case(name), microscope=zoomed))
    # zoom takes what the outermost pixels show from beyond the maps
    inner = np.pad(np.ones((198, 198), bool), 1).ravel()
    columns, rows = (places[inner] for places in grid(name))
    for dx_um, dy_um in ((0.7, -0.9), (-3.1, 2.3), (4.4, 4.9)):
        drawn = Drawn(dx_um=dx_um, dy_um=dy_um, dz_um=z_um)
        image = drawn.render(look).ravel()[inner]
        alone = look.alone(dx_um=dx_um, dy_um=dy_um, dz_um=z_um).ravel()[inner]
        pose = replace(drawn.pose(case(name)), zoom=zoom)
        seen = front(name).at(pose, columns, rows)
        both = joint(name).light(pose, columns, rows, squared=False).value
        off = np.abs(seen.light + seen.through * alone + both - image)
        noise = np.sqrt(look.camera.variance(image))
        rays = LEFT * np.abs(both).max() + rays_error(name, drawn) if z_um else 0.0
        assert (off < 0.1 * noise + rays).all()
        if z_um == 0 and zoom == 1:  # a height of the maps
            assert off.max() < 2 * IMAGE + SLOPE * np.ptp(alone)


def joint(name: str) -> JointBlur:
    """Return what a prepared fit holds of what bodies hide together."""
    found = job(name, render(name)()).joint
    assert found is not None
    return found


@cache
def rays_error(name: str, drawn: Drawn) -> float:
    """Return what an image changes by if all of its bodies move by whole pixels.

    By nothing but for the rays, which start from points of their own.
    """
    here, step_um = case(name), case(name).microscope.um_per_px
    image, worst = drawn.render(render(name)), 0.0
    for right, down in ((1, 0), (0, 1), (2, -1)):
        x, y = right * step_um, -down * step_um
        static = tuple(
            replace(layer, outline=place(layer.outline, x, y, 0.0))
            for layer in here.static
        )
        there = replace(drawn, dx_um=drawn.dx_um + x, dy_um=drawn.dy_um + y)
        moved = there.render(nominal_render(replace(here, static=static)))
        off = np.roll(moved, (-down, -right), (0, 1)) - image
        worst = max(worst, float(np.abs(off[2:-2, 2:-2]).max()))
    return worst


def test_slopes_of_what_bodies_hide_together_are_differences() -> None:
    columns, rows = grid("between")
    pose = replace(Drawn().pose(case("between")), z_um=4.0)
    found = joint("between").light(pose, columns, rows, squared=False)
    steps = {"column": 0.01, "row": 0.01, "turn_rad": 1e-4, "z_um": 0.01, "zoom": 1e-4}
    slopes = (found.across, found.down, found.turn, found.focus, found.grow)
    for (name, step), slope in zip(steps.items(), slopes, strict=True):
        high, low = (
            joint("between").light(
                replace(pose, **{name: getattr(pose, name) + sign * step}),
                columns,
                rows,
                squared=False,
            )
            for sign in (1, -1)
        )
        # parabolas about the nominal place move along: at it their slope is right
        off = (high.value - low.value) / (2 * step) - slope
        assert np.abs(off).max() < 0.01 * np.abs(slope).max(), name


def test_where_focus_has_no_sign_the_occluder_has_it() -> None:
    columns, rows = grid("over_shaft")
    pose = Drawn().pose(case("over_shaft"))
    for z_um in (5.0, -5.0):
        plain = joint("over_shaft").light(
            replace(pose, z_um=z_um), columns, rows, squared=False
        )
        front = OccluderBlur(focus_um=z_um)
        even = joint("over_shaft").light(
            replace(pose, z_um=5.0, front=front), columns, rows, squared=True
        )
        np.testing.assert_array_equal(even.value, plain.value)
        # by the square of the focus: dz = d(z^2) / 2 z
        np.testing.assert_allclose(even.focus, plain.focus / (2 * z_um), rtol=1e-12)


def test_the_share_let_through_is_the_veils_where_the_target_does_not_vary() -> None:
    occluders = render("between").occluders()
    columns, rows = grid("between")
    pose = Drawn().pose(case("between"))
    found = (
        front("between").plain(pose, columns, rows)[1].reshape(occluders.through.shape)
    )
    assert occluders.through.min() < 0.5 < occluders.through.max()
    np.testing.assert_allclose(found, occluders.through, atol=SLOPE)


def test_fronts_focus_beyond_the_heights_is_that_of_the_last() -> None:
    columns, rows = grid("over_shaft")
    pose = Drawn().pose(case("over_shaft"))
    last, beyond = (
        front("over_shaft").at(replace(pose, z_um=z), columns, rows)
        for z in (front("over_shaft").reach_um, 3 * REACH_UM)
    )
    np.testing.assert_array_equal(last.light, beyond.light)
    np.testing.assert_array_equal(last.through, beyond.through)


@pytest.mark.parametrize("zoom", [1.0, 0.995])
def test_slopes_by_the_fronts_focus_are_differences(zoom: float) -> None:
    columns, rows = grid("over_shaft")
    pose = replace(Drawn().pose(case("over_shaft")), zoom=zoom, z_um=4.0)
    # 32 bits of the maps, over the step; a spline's third slope leaves a tenth of that
    low, here, high = (
        front("over_shaft").at(
            replace(pose, front=OccluderBlur(focus_um=z)), columns, rows
        )
        for z in (4.9, 5.0, 5.1)
    )
    atol = 4 * float(np.finfo(np.float32).eps) / 0.2
    np.testing.assert_allclose(
        here.light_slopes[0], (high.light - low.light) / 0.2, atol=atol
    )
    slope = (high.through - low.through) / 0.2
    np.testing.assert_allclose(here.through_slopes[0], slope, atol=atol)


def test_an_odd_number_of_heights_has_focus_in_its_middle() -> None:
    for name in ("between", "over_shaft"):
        assert len(front(name).light) % 2 == 1  # and a coefficient more at both ends
        depth_um = case(name).microscope.wave_depth_um
        assert front(name).reach_um == pytest.approx(REACH_UM + 2 * depth_um)
        assert artifact(name).arrays["front_light"].shape[1:] == (200, 200)


def test_maps_are_read_linearly_between_pixels() -> None:
    """By another interpolation, at a zoom that leaves no pixel where it was."""
    rng = np.random.default_rng(2)
    maps = rng.random((2, 6, 40, 50)).astype(np.float32)
    occluder_modes = np.zeros((0, 40, 50), np.float32)
    seen = Front(
        light=maps[0],
        through=maps[1],
        core_light=maps[0],
        core_through=maps[1],
        reach_um=REACH_UM,
        axis_px=(20.3, 11.6),
        mode_light=occluder_modes,
        mode_through=occluder_modes,
    )
    rows, columns = (place.ravel() for place in np.mgrid[2:38, 3:47])
    pose = ImagePose(
        column=0.0, row=0.0, turn_rad=0.0, z_um=0.0, zoom=0.98,
        front=OccluderBlur(focus_um=REACH_UM),
    )  # fmt: skip
    at = 11.6 + (rows - 11.6) / 0.98, 20.3 + (columns - 20.3) / 0.98
    # at the last height the spline's weights are those of its ends: 1, 4, 1
    for map_, found in zip(maps, seen.plain(pose, columns, rows), strict=True):
        mixed = (map_[3] + 4.0 * map_[4] + map_[5]) / 6
        expected = map_coordinates(mixed.astype(np.float64), at, order=1)
        np.testing.assert_allclose(found, expected, atol=1e-6)
