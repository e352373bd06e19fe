"""Looks at random parts: polygons, arcs and holes, thin slots, teeth, neighbours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from shapely import Point as ShapelyPoint
from shapely import Polygon

from microplan.arrays import Point
from microplan.featuresel.features.contour import with_contour
from microplan.featuresel.look.scenario import LookCase, TrialSpread
from microplan.featuresel.routines.contract import Target
from microplan.optics.lens.lens import LensErrors
from microplan.optics.lens.sensor import Sensor
from microplan.optics.outline.outline import Arc, Outline, Ring, Segment, place
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Illumination, Layer, Window
from microplan.optics.transfer.microscope import Microscope

_RADIUS_UM = 30.0  # of the parts


def random_case(rng: np.random.Generator) -> LookCase:
    """Return a look at a random part, not without contrast against the background."""
    shape = (_blob, _slotted, _toothed)[int(rng.integers(3))](rng)
    own, ground = rng.uniform(0.05, 0.9, 2)
    while abs(own - ground) < 0.15:
        own, ground = rng.uniform(0.05, 0.9, 2)
    layer = Layer(name="part", outline=shape, z_um=0.0, reflectance=float(own))
    scope = Microscope(
        aperture=0.42,
        wavelength_um=0.6,
        medium_index=1.0,
        magnification=float(rng.choice([6.9, 10.0])),
        pitch_um=7.5,
        width_px=640,
        height_px=480,
    )
    half = math.ceil(1.4 * _RADIUS_UM * scope.px_per_um)
    target = Target(
        name="part", kind="outline", column=0, row=0, theta_rad=0.0,
        px_per_um=scope.px_per_um, search_px=8.0, theta_range_rad=0.2, symmetry=1,
        bright=bool(own > ground), parameters={"extent_um": 1.2 * _RADIUS_UM},
    )  # fmt: skip
    case = LookCase(
        key="part",
        static=_neighbours(rng),
        moving=(layer,),
        background=float(ground),
        x_um=float(rng.uniform(-1, 1)),
        y_um=float(rng.uniform(-1, 1)),
        theta_rad=float(rng.uniform(-math.pi, math.pi)),
        theta_any=False,
        microscope=scope,
        focus_um=float(rng.uniform(-30, 30)),
        light=Illumination(gradient_x=float(rng.uniform(-0.3, 0.3))),
        window=Window(
            row=240 - half, column=320 - half, rows=2 * half, columns=2 * half
        ),
        sensor=Sensor(full_well_e=10_000, read_noise_e=10, bits=8),
        target=target,
        model="hopkins",
        sampling=Sampling(),
        lens=LensErrors(),
        lamp_aperture=None,
        background_z_um=None,
        treatment="blend",
        tolerance_um=1.0,
        tolerance_theta_rad=None,
        spread=TrialSpread(
            focus_sigma_um=float(rng.choice([0.0, 1.0, 3.0])),
            magnification_sigma=0.005,
            light_gain=(0.7, 1.3),
            light_gradient=(0.0, 0.3),
            pose_sigma_xy_um=2.0,
            pose_sigma_theta_rad=0.05,
            search_um=8.0,
        ),
    )
    column, row = case.frame.to_pixel(case.x_um, case.y_um)
    target = replace(target, column=column, row=row, theta_rad=case.theta_rad)
    return replace(case, target=with_contour(target, [shape]))


def _neighbours(rng: np.random.Generator) -> tuple[Layer, ...]:
    """Return nothing, or a bar near the part, above or below it."""
    if rng.random() < 0.4:
        return ()
    near, wide = rng.uniform(10, 45), rng.uniform(5, 40)
    bar = polygon([(near, -80), (near + wide, -80), (near + wide, 80), (near, 80)])
    turned = place(
        Outline(rings=(bar,)), 0.0, 0.0, float(rng.uniform(-math.pi, math.pi))
    )
    z_um = float(rng.choice([-1, 1]) * rng.uniform(5, 60))
    return (
        Layer(
            name="bar",
            outline=turned,
            z_um=z_um,
            reflectance=float(rng.uniform(0.05, 0.9)),
        ),
    )


def _blob(rng: np.random.Generator) -> Outline:
    """Return a star-shaped polygon, some with a round hole, some with an arc."""
    count = int(rng.integers(3, 9))
    angles = np.sort(rng.uniform(0, 0.6, count) + np.arange(count)) / count * math.tau
    radii = rng.uniform(0.5, 1.0, count) * _RADIUS_UM
    corners = list(zip(radii * np.cos(angles), radii * np.sin(angles), strict=True))
    rings = [polygon([(float(x), float(y)) for x, y in corners])]
    if rng.random() < 0.3:
        rings = [_half_disc(_RADIUS_UM * float(rng.uniform(0.5, 1)))]
    inner = 0.4 * _RADIUS_UM * 0.5
    if rng.random() < 0.5:
        is_round = len(rings[0].edges) == 2  # a half disc, which has it beside it
        room = inner if is_round else min(inner, _room(corners))
        radius = float(rng.uniform(1.0, inner * 0.7))
        if radius < room:
            rings.append(disc(radius, -inner if is_round else 0.0).reversed())
    return Outline(rings=tuple(rings))


def _room(corners: Sequence[Point]) -> float:
    """Return the radius of the disc about the origin in a polygon, 0 for none."""
    middle, area = ShapelyPoint(0.0, 0.0), Polygon(corners)
    return float(area.exterior.distance(middle)) if area.contains(middle) else 0.0


def _half_disc(radius_um: float) -> Ring:
    """Return a disc's left half."""
    arc = Arc(
        center=(0, 0), radius_um=radius_um, start_rad=math.pi / 2, sweep_rad=math.pi
    )
    return Ring(edges=(arc, Segment(start=arc.end, end=arc.start)))


def _slotted(rng: np.random.Generator) -> Outline:
    """Return a plate with thin slots side by side."""
    half, wide = 0.7 * _RADIUS_UM, float(rng.uniform(1.0, 5.0))
    apart = wide + float(rng.uniform(1.0, 8.0))
    rings = [polygon([(-half, -half), (half, -half), (half, half), (-half, half)])]
    for x in np.arange(-0.8 * half, 0.8 * half - wide, apart):
        low, high = float(x), float(x) + wide
        slot = [(low, -0.6 * half), (high, -0.6 * half), (high, 0.6 * half)]
        rings.append(polygon([*slot, (low, 0.6 * half)]).reversed())
    return Outline(rings=tuple(rings))


def _toothed(rng: np.random.Generator) -> Outline:
    """Return a disc with square teeth, some with a bore."""
    count = int(rng.integers(6, 31))
    root = _RADIUS_UM * float(rng.uniform(0.75, 0.95))
    corners: list[Point] = []
    for k in range(count):
        for part, radius in (
            (0, _RADIUS_UM),
            (0.4, _RADIUS_UM),
            (0.5, root),
            (1, root),
        ):
            turn = (k + min(part, 0.9)) / count * math.tau
            corners.append((radius * math.cos(turn), radius * math.sin(turn)))
    rings = [polygon(corners)]
    if rng.random() < 0.5:
        rings.append(disc(float(rng.uniform(0.1, 0.6)) * root).reversed())
    return Outline(rings=tuple(rings))


def polygon(points: list[Point]) -> Ring:
    """Return straight edges through the points, counter-clockwise."""
    ends = points[1:] + points[:1]
    return Ring(
        edges=tuple(Segment(start=a, end=b) for a, b in zip(points, ends, strict=True))
    )


def disc(radius_um: float, x_um: float = 0.0) -> Ring:
    """Return a full circle, counter-clockwise."""
    arc = Arc(center=(x_um, 0), radius_um=radius_um, start_rad=0, sweep_rad=math.tau)
    return Ring(edges=(arc,))
