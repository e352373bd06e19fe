"""Light from a ring against rays traced point by point through sharp prisms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from microplan.arrays import FloatArray
from microplan.optics.light.lamps import RingLamp, directions, edge_line
from microplan.optics.light.mirrored_strip import lit_share, mirrored_strip
from microplan.optics.light.ring import line_layer, render_ring
from microplan.optics.outline.outline import Outline
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer, Scene
from tests.optics.light.sharp_rays import (
    SharpPrism,
    SharpRounding,
    pixel_points,
    seen_under_ring,
    sharp_polygon,
)
from tests.optics.shapes import disc, gear, microscope, rectangle

SHARP = replace(microscope(6.9, 140, 120), wavelength_um=0.15)
RING = RingLamp(low_rad=math.radians(20), high_rad=math.radians(50))
FLOOR_UM, FLOOR = -30.0, 0.5
SINE = 0.42  # of the lens' half angle
FINGER = rectangle(30, -20, 140, 20)
OVER, RAYS, TO_RING, PIXELS = 5, 4, 6, 30
IndexArray = npt.NDArray[np.int64]
Prism = tuple[Outline, float, float, float]  # outline, low, top, what the face sends


def traced(
    bodies: Sequence[Prism], focus_um: float, seed: int
) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Return rows and columns of some pixels, and what rays find there, (N,) each."""
    rng = np.random.default_rng(0)
    columns, rows = (rng.integers(5, n - 5, PIXELS) for n in (140, 120))
    points = pixel_points(
        columns.astype(float), rows.astype(float), SHARP.um_per_px, (120, 140), OVER
    )
    prisms = [
        SharpPrism(polygon=sharp_polygon(o), low_um=low, top_um=top, sends=sends)
        for o, low, top, sends in bodies
    ]
    seen = seen_under_ring(
        points, prisms, focus_um=focus_um, aperture=SHARP.aperture,
        elevation_rad=(RING.low_rad, RING.high_rad), floor_um=FLOOR_UM, floor=FLOOR,
        rays=RAYS, to_ring=TO_RING, seed=seed,
    )  # fmt: skip
    return rows, columns, seen.reshape(PIXELS, -1).mean(axis=1)


@pytest.mark.parametrize(
    ("bodies", "focus_um"),
    [
        ([(gear(), FLOOR_UM, 0.0, 0.8)], 0.0),
        ([(gear(), 10.0, 30.0, 0.8)], 30.0),
        ([(gear(), FLOOR_UM, 0.0, 0.8), (FINGER, 60.0, 160.0, 0.6)], 0.0),
    ],
)  # fmt: skip
def test_faces_send_their_dull_share_of_the_ring_that_they_see(
    bodies: list[Prism], focus_um: float
) -> None:
    rows, columns, one = traced(bodies, focus_um, 1)
    other = traced(bodies, focus_um, 7)[2]
    own = float(np.std(one - other)) / math.sqrt(2)
    layers = tuple(
        Layer(name=f"b{k}", outline=o, z_um=top, underside_um=low, reflectance=sends)
        for k, (o, low, top, sends) in enumerate(bodies)
    )
    shown = Scene(layers=layers, background=FLOOR, background_z_um=FLOOR_UM)
    found = render_ring(shown, SHARP, focus_um=focus_um, lamp=RING)[rows, columns]
    error = found - (one + other) / 2
    # 25 points a pixel place an edge within a tenth of it; 96 directions and points
    # a twelfth of a shadow apart leave a hundredth of the light
    assert np.sqrt((error**2).mean()) < math.hypot(own, 0.02)
    assert abs(error).max() < 0.1 + 4 * own


def test_without_rays_only_what_they_change_is_left_out() -> None:
    """Of one body, which nothing hides or shades, they change nothing."""
    flat = Layer(name="a", outline=gear(), z_um=0.0, reflectance=0.8)
    finger = Layer(name="b", outline=FINGER, z_um=120.0, reflectance=0.6,
                   underside_um=20.0, wall_reflectance=0.5)  # fmt: skip
    for bodies, is_same in (((flat,), True), ((flat, finger), False)):
        scene = Scene(layers=bodies, background=FLOOR)
        with_rays, without = (
            render_ring(
                scene, SHARP, focus_um=0.0, lamp=RING, sampling=Sampling(rays=rays)
            )
            for rays in (1.0, 0.0)
        )
        assert np.isfinite(without).all()
        assert np.allclose(with_rays, without) == is_same


def test_directions_fill_the_ring_evenly_by_what_they_irradiate() -> None:
    ways = directions(RING, 4000)
    sine2 = (t2 := (ways**2).sum(axis=1)) / (1 + t2)
    ends = math.cos(RING.high_rad) ** 2, math.cos(RING.low_rad) ** 2
    np.testing.assert_allclose(
        np.quantile(sine2, [0, 0.25, 0.5, 1]),
        ends[0] + (ends[1] - ends[0]) * np.array([0, 0.25, 0.5, 1]),
        atol=1e-3,
    )
    np.testing.assert_allclose(ways.mean(axis=0), 0, atol=5e-3)


def test_a_line_mirrors_what_tilts_of_half_the_lights_angle_do() -> None:
    # by counting: tilts of a quarter circle whose mirrored ray comes from the ring
    line = edge_line(RING, mirrored=0.4, radius_um=3.0, rings=1)
    assert line is not None
    inward = (np.arange(100_000) + 0.5) / 100_000 * 3.0  # from the drawn edge
    tilt = np.arcsin(1 - inward / 3.0)
    elevation = math.pi / 2 - 2 * tilt
    lit = (elevation >= RING.low_rad) & (elevation <= RING.high_rad)
    assert line.width_um == pytest.approx(lit.mean() * 3.0, abs=1e-4)
    # of the lamp's radiance, a white dull face sends the ring's squared sines
    assert line.level == pytest.approx(0.4 / RING.spread)


@pytest.mark.parametrize("position", [0.0, 0.5, 1.0])
def test_the_line_lies_within_the_rounding_and_carries_its_light(
    position: float,
) -> None:
    line = edge_line(RING, mirrored=0.4, radius_um=4.0, rings=1)
    assert line is not None
    layer = Layer(name="disc", outline=disc(20.0), z_um=0.0, reflectance=0.3)
    lit = replace(layer, edge_line=line)
    strip = mirrored_strip(RING, SINE)
    bands = line_layer(lit, position, strip)
    assert bands is not None
    by = position * (1 - strip.width) - min(strip.outer)
    areas = [
        math.pi * ((20 - 4 * (outer + by)) ** 2 - (20 - 4 * (inner + by)) ** 2)
        for outer, inner in zip(strip.outer, strip.inner, strict=True)
    ]
    assert bands.outline.area_um2 == pytest.approx(sum(areas))
    scope = microscope(6.9, 80, 80)
    images: list[FloatArray] = [
        render_ring(Scene(layers=(each,), background=0.0), scope, focus_um=0.0,
                    lamp=RING, line=position)
        for each in (lit, layer)
    ]  # fmt: skip
    extra = float((images[0] - images[1]).sum()) * scope.um_per_px**2
    assert extra == pytest.approx(line.level * strip.share * sum(areas), rel=0.01)


def test_each_ray_of_the_pupil_sees_the_ring_by_tilts_of_its_own() -> None:
    # by chance: rays of the pupil, mirrored at normals as Householder does
    rng = np.random.default_rng(3)
    count = 4000
    part = SINE * np.sqrt(rng.random(count))
    angle = rng.uniform(0, 2 * math.pi, count)
    view = np.stack([part * np.cos(angle), part * np.sin(angle), np.sqrt(1 - part**2)])
    inward, share = lit_share(RING, SINE)
    for k in range(0, len(inward), 50):
        tilt = math.asin(1 - inward[k])
        normal = np.array([math.sin(tilt), 0.0, math.cos(tilt)])
        light = (2 * np.outer(normal, normal) - np.eye(3)) @ view
        elevation = np.arcsin(light[2])
        lit = (elevation >= RING.low_rad) & (elevation <= RING.high_rad)
        error = math.sqrt(share[k] * (1 - share[k]) / count)
        assert lit.mean() == pytest.approx(share[k], abs=4 * error + 0.003)
    # a narrow pupil sees what a single ray along the axis does
    narrow = mirrored_strip(RING, 1e-6)
    line = edge_line(RING, mirrored=1.0, radius_um=1.0, rings=1)
    assert line is not None
    assert narrow.width == pytest.approx(line.width_um, abs=2e-3)
    assert narrow.share * 3 == pytest.approx(1.0, abs=0.01)


def test_stairs_of_a_strip_send_what_the_strip_does() -> None:
    inward, share = lit_share(RING, SINE)
    strip = mirrored_strip(RING, SINE)
    outer, inner = np.array(strip.outer), np.array(strip.inner)
    wide, middle = inner - outer, (inner + outer) / 2
    total = share.mean()
    assert strip.share * wide.sum() == pytest.approx(total, rel=1e-9)
    # a stair of three lies within a sixth of the largest share
    mean = (inward * share).mean() / total
    sigma = math.sqrt(((inward - mean) ** 2 * share).mean() / total)
    assert (wide * middle).sum() / wide.sum() == pytest.approx(mean, abs=0.01)
    spread = (wide * ((middle - mean) ** 2 + wide**2 / 12)).sum() / wide.sum()
    assert math.sqrt(spread) == pytest.approx(sigma, rel=1 / 6)


def test_rays_find_a_rounded_mirror_as_bright_as_its_strip() -> None:
    radius_um = 4.0
    plate = SharpPrism(
        polygon=sharp_polygon(rectangle(-40, -40, 0, 40)),
        low_um=FLOOR_UM,
        top_um=0.0,
        rounding=SharpRounding(level=1.0, radius_um=radius_um),
    )
    x = -radius_um * (np.arange(80) + 0.5) / 80
    seen = seen_under_ring(
        np.column_stack([x, np.zeros(80)]), [plate], focus_um=0.0, aperture=SINE,
        elevation_rad=(RING.low_rad, RING.high_rad), floor_um=FLOOR_UM, floor=0.0,
        rays=400, to_ring=1,
    )  # fmt: skip
    inward, share = lit_share(RING, SINE)
    # the strip lies up to .3 radii below the face, where rays from there have spread by
    # .3 x .46 of one at most, to both sides
    assert seen.mean() == pytest.approx(share.mean(), rel=0.04)
    middle = -(x * seen).sum() / seen.sum() / radius_um
    assert middle == pytest.approx((inward * share).sum() / share.sum(), abs=0.07)


def test_a_dull_edge_has_no_line_and_a_large_rounding_is_refused() -> None:
    assert edge_line(RING, mirrored=0.0, radius_um=1.0, rings=1) is None
    assert edge_line(RING, mirrored=0.5, radius_um=0.0, rings=1) is None
    line = edge_line(RING, mirrored=0.5, radius_um=30.0, rings=1)
    thin = Layer(name="thin", outline=rectangle(0, 0, 3, 40), z_um=0.0,
                 reflectance=0.3, edge_line=line)  # fmt: skip
    with pytest.raises(ValueError, match="vanish"):
        line_layer(thin, 0.5, mirrored_strip(RING, SINE))
