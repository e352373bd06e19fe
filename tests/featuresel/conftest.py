"""The gear-on-shaft job's outlines and looks, as the routines meet them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import pytest

from featuresel.case import LookCase, Spread
from featuresel.routines import Target, TargetKind
from optics.microscope import Microscope
from optics.outline import Arc, Outline, Ring, Segment
from optics.scene import Illumination, Layer, Window
from optics.sensor import Sensor

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
SPREAD = Spread(
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
        tolerance_um=1.0,
        tolerance_theta_rad=None,
        spread=SPREAD,
    )  # fmt: skip
    return on_target(replace(case, **changes))


def on_target(case: LookCase) -> LookCase:
    """Return the case with the target's pixels made to agree with its pose."""
    column, row = case.frame.to_pixel(case.x_um, case.y_um)
    return replace(
        case,
        target=replace(
            case.target,
            column=column,
            row=row,
            theta_rad=case.theta_rad,
            theta_range_rad=math.pi if case.theta_any else case.target.theta_range_rad,
            px_per_um=case.microscope.px_per_um,
        ),
    )


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
    return replace(case, theta_any=False)


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


@pytest.fixture
def look() -> Callable[[str], LookCase]:
    """Return the maker of a named look."""
    return lambda name: CASES[name]()
