"""The gear-on-shaft job's outlines and looks, as the routines meet them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.featuresel.features.contour import with_contour
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase, TrialSpread
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    Routine,
    Target,
    TargetKind,
)
from microplan.featuresel.routines.registry import load
from microplan.optics.lens.lens import LensErrors
from microplan.optics.lens.sensor import Sensor, expose, to_unit
from microplan.optics.outline.outline import Arc, Outline, Ring, Segment
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Illumination, Layer, Window
from microplan.optics.transfer.microscope import Microscope

MICROSCOPE = Microscope(
    aperture=0.42,
    wavelength_um=0.6,
    medium_index=1.0,
    magnification=6.9,
    pitch_um=7.5,
    width_px=640,
    height_px=480,
)
SENSOR = Sensor(full_well_e=10_000, read_noise_e=10, bits=8)
SPREAD = TrialSpread(
    focus_sigma_um=4,
    magnification_sigma=0.005,
    light_gain=(0.7, 1.3),
    light_gradient=(0.0, 0.3),
    pose_sigma_xy_um=2,
    pose_sigma_theta_rad=math.radians(5),
    search_um=10,
)
TEETH = 18
GEAR = {
    "count": 18.0, "outer_um": 50.0, "root_um": 45.0, "phase_rad": 0.0,
    "notch_rad": math.pi / 2, "notch_radius_um": 27.5, "notch_width_um": 6.0,
    "bore_um": 25.0,
}  # fmt: skip
JAWS = {"opening_um": 130.0, "finger_width_um": 100.0, "grip_from_tip_um": 60.0}


def disc(radius_um: float, x_um: float = 0.0, y_um: float = 0.0) -> Ring:
    """Return a full circle, counter-clockwise."""
    arc = Arc(center=(x_um, y_um), radius_um=radius_um, start_rad=0, sweep_rad=math.tau)
    return Ring(edges=(arc,))


def polygon(*points: tuple[float, float]) -> Ring:
    """Return straight edges through the points."""
    ends = points[1:] + points[:1]
    return Ring(
        edges=tuple(Segment(start=a, end=b) for a, b in zip(points, ends, strict=True))
    )


def gear(*, notch: bool = True) -> Outline:
    """Return the 18-tooth gear: a tooth at 0, the notch of the bore at 90 degrees."""
    points = []
    for k in range(TEETH):
        for radius, angle in ((50, -4), (50, 4), (45, 6), (45, 14)):
            turn = math.radians(20 * k + angle)
            points.append((radius * math.cos(turn), radius * math.sin(turn)))
    bore = _notched_bore() if notch else disc(25).reversed()
    return Outline(rings=(polygon(*points), bore))


def _notched_bore() -> Ring:
    half = math.asin(3 / 25)
    arc = Arc(
        center=(0, 0),
        radius_um=25,
        start_rad=math.pi / 2 + half,
        sweep_rad=math.tau - 2 * half,
    )
    corners = (arc.end, (3.0, 30.0), (-3.0, 30.0), arc.start)
    sides = [Segment(start=a, end=b) for a, b in itertools.pairwise(corners)]
    return Ring(edges=(arc, *sides)).reversed()


def fingers(opening_um: float = 130.0) -> Outline:
    """Return both fingers about the grip, 20 mm long, tips at y = -60."""
    rings = []
    for side in (-1, 1):
        inner, outer = side * opening_um / 2, side * (opening_um / 2 + 100)
        low, high = min(inner, outer), max(inner, outer)
        rings.append(polygon((low, -60), (high, -60), (high, 20740), (low, 20740)))
    return Outline(rings=tuple(rings))


def make_case(
    kind: TargetKind,
    parameters: Mapping[str, float],
    moving: tuple[Layer, ...],
    *,
    static: tuple[Layer, ...] = (),
    bright: bool = True,
    half_px: tuple[int, int] = (100, 100),
    focus_um: float = 0.0,
    **changes: Any,
) -> LookCase:
    """Return a look at a target near the image's centre, a fraction of a pixel off."""
    rows, columns = 2 * half_px[0], 2 * half_px[1]
    window = Window(
        row=240 - half_px[0], column=320 - half_px[1], rows=rows, columns=columns
    )
    case = LookCase(
        key=f"{kind}-case",
        static=static,
        moving=moving,
        background=0.10,
        x_um=0.3,
        y_um=-0.2,
        theta_rad=0.1,
        theta_any=False,
        microscope=MICROSCOPE,
        focus_um=focus_um,
        light=Illumination(),
        window=window,
        sensor=SENSOR,
        target=Target(
            name="part", kind=kind, column=0, row=0, theta_rad=0.1, px_per_um=0.92,
            search_px=11.0, theta_range_rad=0.26, symmetry=1, bright=bright,
            parameters=parameters,
        ),
        model="hopkins",
        sampling=Sampling(),
        lens=LensErrors(),
        lamp_aperture=None,
        background_z_um=None,
        treatment="blend",
        tolerance_um=1.0,
        tolerance_theta_rad=None,
        spread=SPREAD,
    )  # fmt: skip
    return on_target(replace(case, **changes))


def on_target(case: LookCase) -> LookCase:
    """Return the case with the target's pixels made to agree with its pose."""
    column, row = case.frame.to_pixel(case.x_um, case.y_um)
    target = replace(
        case.target,
        column=column,
        row=row,
        theta_rad=case.theta_rad,
        theta_range_rad=math.pi if case.theta_any else case.target.theta_range_rad,
        px_per_um=case.microscope.px_per_um,
    )
    outlines = [layer.outline for layer in case.moving]
    return replace(case, target=with_contour(target, outlines))


def gear_layer(z_um: float = 0.0) -> Layer:
    return Layer(name="gear", outline=gear(), z_um=z_um, reflectance=0.8)


def post_layer(z_um: float = 0.0) -> Layer:
    outline = Outline(rings=(disc(22),))
    return Layer(name="post", outline=outline, z_um=z_um, reflectance=0.75)


def finger_layer(z_um: float = 0.0, opening_um: float = 130.0) -> Layer:
    return Layer(
        name="fingers", outline=fingers(opening_um), z_um=z_um, reflectance=0.7
    )


def find_gear() -> LookCase:
    case = make_case("teeth", GEAR, (gear_layer(),), theta_any=True)
    return replace(case, key="find_gear", target=replace(case.target, symmetry=TEETH))


def between_fingers() -> LookCase:
    """The gear in focus, the fingers' tops 130 um above it."""
    case = replace(find_gear(), static=(finger_layer(130.0),), key="between")
    target = replace(case.target, theta_range_rad=0.26)
    return replace(case, theta_any=False, target=target)


def bore_in_fingers() -> LookCase:
    bore = {"radius_um": 25.0}
    case = make_case("circle", bore, (gear_layer(),), bright=False)
    return replace(case, key="bore")


def over_shaft() -> LookCase:
    """The post in focus, seen through the bore of the gear 110 um above it."""
    case = make_case(
        "circle", {"radius_um": 22.0}, (post_layer(),), static=(gear_layer(110.0),)
    )
    return replace(case, key="over_shaft", background=0.15)


def post_alone() -> LookCase:
    case = make_case("circle", {"radius_um": 22.0}, (post_layer(),))
    return replace(case, key="post", background=0.15)


def see_fingers() -> LookCase:
    return make_case(
        "jaws",
        JAWS,
        (finger_layer(),),
        half_px=(120, 190),
        theta_rad=0.0,
        y_um=-20.0,
        key="jaws",
    )


def bracket() -> LookCase:
    """An L with a hole, at any angle: a drawing nobody prepared a routine for."""
    ell = polygon((-60, -50), (60, -50), (60, -20), (-20, -20), (-20, 60), (-60, 60))
    layer = Layer(
        name="bracket",
        outline=Outline(rings=(ell, disc(10, -40, 40).reversed())),
        z_um=0.0,
        reflectance=0.7,
    )
    case = make_case("outline", {"extent_um": 85.0}, (layer,), half_px=(110, 110))
    return on_target(replace(case, key="bracket", theta_any=True))


CASES: Mapping[str, Callable[[], LookCase]] = {
    "find_gear": find_gear,
    "between": between_fingers,
    "bore": bore_in_fingers,
    "over_shaft": over_shaft,
    "post": post_alone,
    "jaws": see_fingers,
    "bracket": bracket,
}


@dataclass(frozen=True)
class Sample:
    """What one routine said of noisy images at random sub-pixel poses."""

    errors_um: FloatArray  # (N, 2) measured - true, world
    turns_rad: FloatArray  # (M,) of those that gave an angle
    spreads_um: FloatArray  # (N,) the routine's own
    failures: tuple[str, ...]
    limit_um: float  # Cramer-Rao bound per axis


def noisy(case: LookCase, image: FloatArray, rng: np.random.Generator) -> FloatArray:
    return to_unit(expose(image, case.sensor, rng), case.sensor.bits)


def sample(
    case: LookCase, name: str, *, draws: int = 25, within_um: float = 6
) -> Sample:
    """Return the errors of one routine; poses and noise come from a fixed seed."""
    rng = np.random.default_rng(20)
    render, routine = nominal_render(case), load(name)
    artifact = routine.prepare(render, case.target)
    assert isinstance(artifact, Artifact), artifact
    errors, turns, spreads, failures = [], [], [], []
    for _ in range(draws):
        dx, dy = rng.uniform(-within_um, within_um, 2)
        turn = rng.uniform(-math.pi, math.pi) if case.theta_any else 0.0
        image = noisy(case, render(dx_um=dx, dy_um=dy, theta_rad=turn), rng)
        found = routine.measure(image, artifact, guess(case, routine, dx, dy))
        if isinstance(found, Failure):
            failures.append(found.code)
            continue
        x, y = case.frame.to_world(found.column, found.row)
        errors.append((x - case.x_um - dx, y - case.y_um - dy))
        spreads.append(found.spread_px * case.microscope.um_per_px)
        if found.theta_rad is not None:
            off = found.theta_rad - case.theta_rad - turn
            turns.append(math.remainder(off, math.tau))
    return Sample(
        errors_um=np.array(errors).reshape(-1, 2),
        turns_rad=np.array(turns),
        spreads_um=np.array(spreads),
        failures=tuple(failures),
        limit_um=limit_um(case),
    )


def guess(case: LookCase, routine: Routine, dx: float, dy: float) -> Guess:
    """Return the nominal place, or for what needs a seed one .1 px off the true."""
    column, row = case.target.column, case.target.row
    theta = None if case.theta_any else case.theta_rad
    if "xy" in routine.requires:
        k = case.target.px_per_um
        column, row = column + dx * k + 0.1, row - dy * k - 0.1
    return Guess(column=column, row=row, theta_rad=theta)


def limit_um(case: LookCase) -> float:
    """Return the Cramer-Rao bound of a place per axis, by finite differences."""
    render, step = nominal_render(case), 0.05
    mean = render()
    dx = (render(dx_um=step) - render(dx_um=-step)) / (2 * step)
    dy = (render(dy_um=step) - render(dy_um=-step)) / (2 * step)
    sensor = case.sensor
    full, levels = sensor.full_well_e, 2**sensor.bits - 1
    variance = mean / full + (sensor.read_noise_e / full) ** 2 + 1 / 12 / levels**2
    fisher = [[(a * b / variance).sum() for a in (dx, dy)] for b in (dx, dy)]
    return float(np.sqrt(np.diag(np.linalg.inv(np.array(fisher))).max()))


@pytest.fixture
def look() -> Callable[[str], LookCase]:
    """Return the maker of a named look."""
    return lambda name: CASES[name]()


@pytest.fixture
def measured() -> Callable[..., Sample]:
    """Return what samples a routine on a look."""
    return sample


@pytest.fixture
def expose_image() -> Callable[..., FloatArray]:
    """Return what adds the camera's noise."""
    return noisy
