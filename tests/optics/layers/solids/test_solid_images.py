"""Images of solid bodies against rays traced one by one through prisms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.optics.layers.coaxial_light import pixel_axes_um
from microplan.optics.layers.shading import render_coaxial
from microplan.optics.layers.wall_error import wall_error
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer, Scene, Window
from tests.optics.layers.solids.brute_rays import prism, seen
from tests.optics.shapes import disc, gear, microscope, rectangle

LENS = LAMP = 0.42
WINDOW = Window(row=16, column=36, rows=88, columns=88)
OPTICS = microscope()
RAYS = 1500  # a pixel: their mean errs by less than .25 / sqrt(1500), .0065, and less
# where they lie in cells: two runs differ by .002 rms
FLOOR = 0.1


def seated(wall: float, finish: float, *, flat: bool = False) -> Scene:
    """Return a gear of 100 um about a post of 250 um, on a stage."""
    bodies = (
        Layer(name="gear", outline=gear(), z_um=100.0, reflectance=0.8,
              underside_um=0.0, wall_reflectance=wall, finish=finish),
        Layer(name="post", outline=disc(22.0, (0.5, -0.3)), z_um=250.0,
              reflectance=0.75, underside_um=0.0, wall_reflectance=wall,
              finish=finish),
    )  # fmt: skip
    if flat:
        bodies = (replace(bodies[0], underside_um=None),
                  replace(bodies[1], underside_um=None))  # fmt: skip
    return Scene(layers=bodies, background=FLOOR, background_z_um=0.0)


@cache  # tests ask for the same scenes, from several sides
def image(scene: Scene, focus_um: float, lamp: float = LAMP) -> FloatArray:
    """Return the region."""
    found = render_coaxial(
        scene, OPTICS, focus_um=focus_um, lamp_aperture=lamp, window=WINDOW
    )
    found.setflags(write=False)
    return found


def pixels(radii_um: tuple[float, ...]) -> list[tuple[int, int]]:
    """Return pixels about the middle, at so many radii in other directions."""
    angles = 0.4 + 2.4 * np.arange(len(radii_um))
    x, y = np.array(radii_um) * np.stack([np.cos(angles), np.sin(angles)])
    p = OPTICS.um_per_px
    return [
        (round(43.5 - v / p), round(43.5 + u / p)) for u, v in zip(x, y, strict=True)
    ]


def traced(
    scene: Scene,
    at: Sequence[tuple[int, int]],
    focus_um: float,
    floor_um: float = 0.0,
    lamp: float = LAMP,
) -> FloatArray:
    """Return what rays one by one see at pixels' centres."""
    return _traced(scene, tuple(at), focus_um, floor_um, lamp)


@cache
def _traced(
    scene: Scene,
    at: tuple[tuple[int, int], ...],
    focus_um: float,
    floor_um: float,
    lamp: float,
) -> FloatArray:
    x, y = pixel_axes_um(OPTICS, WINDOW, (0.0, 0.0))
    points = np.array([(x[0] + x[1] * c, y[0] + y[1] * r) for r, c in at])
    found = seen(
        [prism(layer) for layer in scene.layers], (FLOOR, floor_um), points,
        aperture=OPTICS.aperture, lamp=lamp, focus_um=focus_um,
        rays=RAYS, rng=np.random.default_rng(5),
    )  # fmt: skip
    found.setflags(write=False)
    return found


# away from edges in focus: the lens blurs those, and rays do not
RADII = (8.0, 14.0, 29.0, 33.0, 37.0, 41.0)


@pytest.mark.parametrize(
    ("wall", "finish", "rms"), [(0.0, 0.0, 0.01), (0.0, 1.0, 0.01), (0.7, 0.0, 0.02)]
)
def test_walls_hide_and_mirror_as_rays_one_by_one_find(
    wall: float, finish: float, rms: float
) -> None:
    """What walls change, of which rays that do not diffract can tell.

    The judge errs by .003 rms; mirrored rays show edges in focus on points 3 um apart.
    """
    solid, flat = (seated(wall, finish, flat=flat) for flat in (False, True))
    at = pixels(RADII)
    rows, columns = np.array(at).T
    truth = traced(solid, at, 100.0) - traced(flat, at, 100.0)
    change = (image(solid, 100.0) - image(flat, 100.0))[rows, columns]
    assert np.sqrt(np.mean((change - truth) ** 2)) < rms
    assert np.sqrt(np.mean(truth**2)) > 0.03


def test_a_black_wall_through_the_plane_in_focus_is_sharp_there() -> None:
    """A jaw 200 um high beside a plate in focus: nothing of its inside leaks out."""
    plate = Layer(name="plate", outline=rectangle(-20, -200, 200, 200), z_um=100.0,
                  reflectance=0.8, underside_um=0.0)  # fmt: skip
    jaw = Layer(name="jaw", outline=rectangle(-300, -300, -20, 300), z_um=240.0,
                reflectance=0.7, underside_um=40.0)  # fmt: skip
    solid = Scene(layers=(plate, jaw), background=FLOOR, background_z_um=-260.0)
    faces = tuple(replace(la, underside_um=None) for la in solid.layers)
    flat = replace(solid, layers=faces)
    x = (np.arange(WINDOW.columns) - 43.5) * OPTICS.um_per_px
    near = np.flatnonzero(np.abs(x + 20) < 7)
    at = [(44, int(column)) for column in near]
    truth = traced(solid, at, 100.0, -260.0) - traced(flat, at, 100.0, -260.0)
    change = (image(solid, 100.0) - image(flat, 100.0))[44, near]
    np.testing.assert_allclose(change, truth, atol=0.0065)  # of `RAYS`


def test_a_perfect_mirror_wall_takes_no_light_from_an_even_floor() -> None:
    """Every ray and every lamp ray comes out again: the floor looks as if alone."""
    wide = Layer(name="wall", outline=rectangle(-600, -600, -20, 600), z_um=100.0,
                 reflectance=0.8, underside_um=0.0, wall_reflectance=1.0)  # fmt: skip
    scene = Scene(layers=(wide,), background=FLOOR, background_z_um=0.0)
    bright = image(scene, 100.0)[:, 48:]
    assert np.abs(bright - FLOOR).max() < 0.08 * FLOOR
    black = replace(scene, layers=(replace(wide, wall_reflectance=0.0),))
    assert image(black, 100.0)[:, 30].max() < 0.7 * FLOOR


def test_what_a_wall_mirrors_is_lit_as_it_is_beyond_the_picture() -> None:
    """Over a jaw's end a small picture: all that is mirrored lies outside it."""
    plate = Layer(name="plate", outline=rectangle(-450, -250, 450, 450), z_um=-10.0,
                  reflectance=0.3)  # fmt: skip
    jaw = Layer(name="jaw", outline=rectangle(-20, -50, 140, 450), z_um=230.0,
                reflectance=0.7, underside_um=30.0, wall_reflectance=1.0)  # fmt: skip
    scene = Scene(layers=(plate, jaw), background=FLOOR, background_z_um=-160.0)
    window = Window(row=WINDOW.row + 34, column=WINDOW.column + 34, rows=21, columns=21)
    at = [(r, c) for r in (2, 10, 18) for c in (2, 10, 18)]
    shown = render_coaxial(
        scene, OPTICS, focus_um=-10.0, lamp_aperture=LAMP, window=window
    )
    inside = [(r + 34, c + 34) for r, c in at]
    truth = traced(scene, inside, -10.0, -160.0)
    rows, columns = np.array(at).T
    # the judge errs by .0065; with the light at the picture's rim all over, by .06
    np.testing.assert_allclose(shown[rows, columns], truth, atol=0.015)


def test_an_edge_in_focus_is_as_sharp_and_where_it_is_in_a_mirror() -> None:
    """Across the wall of a jaw that stands on a plate's edge, at a right angle."""
    edge_um = 0.4
    plate = Layer(name="plate", outline=rectangle(-300, -300, 300, edge_um), z_um=100.0,
                  reflectance=0.8)  # fmt: skip
    jaw = Layer(name="jaw", outline=rectangle(20, -400, 320, 400), z_um=240.0,
                reflectance=0.0, underside_um=40.0, wall_reflectance=1.0)  # fmt: skip
    scene = Scene(layers=(plate, jaw), background=0.0, background_z_um=-260.0)
    shown = image(scene, 100.0)
    at = 43.5 + 20 / OPTICS.um_per_px
    found = []
    for side in (-6, 6):  # pixels from the wall
        profile = shown[36:52, round(at) + side]
        found.append((profile - profile[-1]) / (profile[0] - profile[-1]))
    assert found[0].min() < 0.05
    assert found[0].max() > 0.95
    np.testing.assert_allclose(found[1], found[0], atol=0.1)  # of 64 rays


@pytest.mark.parametrize(
    ("wall", "finish"),
    [(0.0, 0.0), (0.7, 0.0), pytest.param(1.0, 1.0, marks=pytest.mark.slow)],
)
def test_the_error_that_is_predicted_of_walls_holds(wall: float, finish: float) -> None:
    scene = seated(wall, finish)
    found = wall_error(scene, OPTICS, focus_um=100.0, lamp_aperture=LAMP, window=WINDOW)
    at = pixels(RADII)
    rows, columns = np.array(at).T
    apart = np.abs(image(scene, 100.0)[rows, columns] - traced(scene, at, 100.0))
    assert apart.max() < found + 2 * 0.0065  # the judge's
    flat = seated(wall, finish, flat=True)
    none = wall_error(flat, OPTICS, focus_um=100.0, lamp_aperture=LAMP, window=WINDOW)
    assert none == 0.0 < found


def test_a_thin_body_is_its_face() -> None:
    scene = seated(0.0, 0.0, flat=True)
    layers = tuple(replace(la, underside_um=la.z_um) for la in scene.layers)
    np.testing.assert_array_equal(
        image(scene, 100.0), image(replace(scene, layers=layers), 100.0)
    )


def bored(finish: float, *, flat: bool = False) -> Scene:
    """Return a post through the bore of a gear, to one side."""
    scene = seated(0.0, finish, flat=flat)
    moved = replace(scene.layers[1], outline=disc(22.0, (2.5, 1.0)))
    return replace(scene, layers=(scene.layers[0], moved))


@pytest.mark.parametrize(("finish", "flat"), [(0.5, False), (1.0, False), (1.0, True)])
def test_a_mirror_shows_a_higher_body_twice(finish: float, flat: bool) -> None:
    """A post through the bore of a gear that is polished: as rays find."""
    scene = bored(finish, flat=flat)
    at = pixels(RADII)
    rows, columns = np.array(at).T
    apart = image(scene, 100.0)[rows, columns] - traced(scene, at, 100.0)
    # dull faces err by .005 rms, the judge by .003
    assert np.sqrt(np.mean(apart**2)) < 0.008


@pytest.mark.parametrize(
    ("finish", "flat", "lamp"), [(1.0, False, 0.2), (0.5, True, 0.2), (1.0, False, 0.1)]
)
def test_a_mirror_under_a_narrow_lamp_shows_what_its_cone_finds(
    finish: float, flat: bool, lamp: float
) -> None:
    scene = bored(finish, flat=flat)
    at = pixels(RADII)
    rows, columns = np.array(at).T
    truth = traced(scene, at, 100.0, lamp=lamp)
    apart = image(scene, 100.0, lamp)[rows, columns] - truth
    # faces err by .005 rms, rays of .8 or 0 by half of .8 over the root of those that
    # the lamp sends, and by half of that where they lie in cells
    noise = 0.8 / 4 / np.sqrt(RAYS * (lamp / LENS) ** 2)
    assert np.sqrt(np.mean(apart**2)) < np.hypot(0.005, noise)
    wide = image(scene, 100.0)[rows, columns]
    assert np.sqrt(np.mean((wide - truth) ** 2)) > 0.07


@pytest.mark.parametrize("lamp", [pytest.param(LENS, marks=pytest.mark.slow), 0.2])
def test_a_mirror_beside_a_wall_that_mirrors_is_lit_past_it(lamp: float) -> None:
    scene = seated(0.7, 1.0)
    at = pixels(RADII)
    rows, columns = np.array(at).T
    truth = traced(scene, at, 100.0, lamp=lamp)
    apart = image(scene, 100.0, lamp)[rows, columns] - truth
    assert np.sqrt(np.mean(apart**2)) < 0.02  # as with dull faces, see above


def test_a_mirror_face_gives_back_the_pupils_share_once() -> None:
    """A hole through a thick black plate, over a face that is dull or polished."""
    outer = rectangle(-300, -300, 300, 300)
    ring = replace(outer, rings=(*outer.rings, gear().rings[1]))
    plate = Layer(name="plate", outline=ring, z_um=100.0, reflectance=0.0)
    found = []
    middle = Window(row=WINDOW.row + 42, column=WINDOW.column + 42, rows=3, columns=3)
    sharp = replace(OPTICS, wavelength_um=0.05)  # no diffraction into the image's edge
    for finish in (0.0, 1.0):
        bed = Layer(name="bed", outline=outer, z_um=0.0, reflectance=0.8, finish=finish)
        scene = Scene(layers=(bed, plate), background=0.0, background_z_um=-1.0)
        seen = render_coaxial(
            scene, sharp, focus_um=0.0, lamp_aperture=LAMP, window=middle
        )
        found.append(seen[1, 1] / 0.8)
    # the share of the pupil that a bore of 25 um leaves 100 um above it
    share = (np.sin(np.arctan(25 / 100)) / 0.42) ** 2
    # a point d off the middle loses 4 d / (25 pi) to the bore's image: here d is .77
    # of a pixel in the mean
    once = share * (1 - 4 * 0.77 * OPTICS.um_per_px / (25 * np.pi))
    np.testing.assert_allclose(found, [share**2, once], atol=0.02)


def test_a_mirror_below_bodies_one_on_another_is_not_too_bright() -> None:
    """Jaws at a gear, all far above a polished plate: a ray's share meets them all."""
    jaws = [
        Layer(name=f"jaw {left}", outline=rectangle(left, -60, left + 160, 600),
              z_um=500.0, reflectance=0.7, underside_um=300.0)
        for left in (-210.0, 50.0)
    ]  # fmt: skip
    wheel = Layer(name="gear", outline=gear(), z_um=360.0, reflectance=0.8,
                  underside_um=260.0)  # fmt: skip
    plate = Layer(name="plate", outline=rectangle(-700, -700, 700, 700), z_um=0.0,
                  reflectance=0.8, finish=1.0)  # fmt: skip
    scene = Scene(layers=(plate, wheel, *jaws), background=FLOOR, background_z_um=-1.0)
    at = [(row, column) for row in (4, 30, 57, 83) for column in (4, 30, 57, 83)]
    rows, columns = np.array(at).T
    apart = image(scene, 250.0)[rows, columns] - traced(scene, at, 250.0, -1.0)
    assert abs(np.mean(apart)) < 2 * 0.0065 / np.sqrt(len(at)) + 0.003


def few_rays(scene: Scene, focus_um: float) -> FloatArray:
    """Return the region as trials have it."""
    return render_coaxial(
        scene, OPTICS, focus_um=focus_um, lamp_aperture=LAMP, window=WINDOW,
        sampling=Sampling(rays=0.5),
    )  # fmt: skip


@pytest.mark.parametrize(
    "focus_um", [pytest.param(100.0, marks=pytest.mark.slow), 250.0]
)
def test_points_and_rays_farther_apart_show_walls_a_little_worse(
    focus_um: float,
) -> None:
    """As trials have them: by less than a third of what leaving walls out costs."""
    scene = seated(0.6, 0.5)
    whole = image(scene, focus_um)
    few = few_rays(scene, focus_um)
    without = image(seated(0.0, 0.0, flat=True), focus_um)
    off, missed = (np.sqrt(np.mean((each - whole) ** 2)) for each in (few, without))
    assert 0 < off < missed / 3


@pytest.mark.parametrize("focus_um", [100.0, 60.0])
def test_rays_are_the_same_however_many_are_traced_at_once(
    focus_um: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = seated(0.6, 0.5)
    whole = few_rays(scene, focus_um)
    monkeypatch.setattr("microplan.optics.layers.solids.solid_bodies._AT_ONCE", 1 << 14)
    np.testing.assert_array_equal(few_rays(scene, focus_um), whole)


@pytest.mark.parametrize("focus_um", [100.0, 60.0])
def test_what_a_lens_changes_needs_no_rays(focus_um: float) -> None:
    """Coma moves faces; what these hide and shade together is nearly the same."""
    scene, both = seated(0.0, 0.0, flat=True), []
    for rays in (0.0, 1.0):
        plain, moved = (
            render_coaxial(
                scene, replace(OPTICS, wavefront=terms), focus_um=focus_um,
                lamp_aperture=LAMP, window=WINDOW, sampling=Sampling(rays=rays),
            )
            for terms in ((), ((8, 0.05),))
        )  # fmt: skip
        both.append(moved - plain)
    without, whole = both
    assert np.abs(whole).max() > 2e-3
    assert np.std(without - whole) < 0.05 * np.std(whole)


@pytest.mark.parametrize("value", [-1.0, np.inf, np.nan])
def test_no_points_are_no_sampling(value: float) -> None:
    with pytest.raises(ValueError, match="rays"):
        Sampling(rays=value)
    for walls in (value, 0.0):
        with pytest.raises(ValueError, match="walls"):
            Sampling(walls=walls)
