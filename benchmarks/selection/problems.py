"""Random selection problems: a feature, how it is seen, and how well it must be found.

Regions are small and the chains those of cheap routines, so that hundreds of problems
can be tried hundreds of times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.featuresel.look.scenario import LookCase, TrialSpread
from microplan.featuresel.routines.contract import Target, TargetKind
from microplan.featuresel.trials.chains import Chain
from microplan.optics.lens.lens import LensErrors
from microplan.optics.lens.sensor import Sensor
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Illumination, Layer, Window
from microplan.optics.transfer.microscope import Microscope
from tests.optics.shapes import circle, disc, polygon, rectangle

SEED = 29
_HALF_PX = 32  # of the region
_KINDS = ("disc", "bore", "bar", "ell", "wedge")
_CHAINS: dict[TargetKind, tuple[Chain, ...]] = {
    "circle": (
        ("otsu", "circle_caliper"),
        ("circle_caliper",),
        ("ncc",),
        ("otsu",),
    ),
    "outline": (("ncc",), ("otsu", "ncc"), ("otsu",)),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """A look, and the chains among which one is to be chosen."""

    case: LookCase
    chains: tuple[Chain, ...]


def draw(index: int) -> Problem:
    """Return problem number `index`: the same whatever else is drawn."""
    rng = np.random.default_rng(np.random.SeedSequence([SEED, index]))
    scope = _microscope(rng)
    reach_um = rng.uniform(8, 16) * scope.um_per_px  # of the feature from its middle
    name = str(rng.choice(_KINDS))
    low = float(rng.uniform(0.05, 0.6))
    high = float(rng.uniform(low + 0.2, 0.85))
    bright = bool(rng.random() < 0.5) if name == "disc" else name != "bore"
    part = Layer(
        name="part",
        outline=_outline(rng, name, reach_um),
        z_um=0.0,
        reflectance=high if bright or name == "bore" else low,
    )
    kind: TargetKind = "circle" if name in ("disc", "bore") else "outline"
    case = LookCase(
        key=f"selection {index}",
        static=_neighbour(rng, reach_um, scope),
        moving=(part,),
        background=low if bright or name == "bore" else high,
        x_um=rng.uniform(-0.5, 0.5) * scope.um_per_px,
        y_um=rng.uniform(-0.5, 0.5) * scope.um_per_px,
        theta_rad=rng.uniform(-math.pi, math.pi),
        theta_any=False,
        microscope=scope,
        focus_um=float(rng.choice([0.0, rng.normal(0, 6)])),
        light=Illumination(gain=0.8),
        window=Window(row=0, column=0, rows=2 * _HALF_PX, columns=2 * _HALF_PX),
        sensor=Sensor(
            full_well_e=rng.uniform(5e3, 4e4),
            read_noise_e=rng.uniform(3, 20),
            bits=int(rng.choice([8, 10, 12])),
        ),
        target=_target(kind, reach_um, bright=bright),
        model="hopkins",
        sampling=Sampling(),
        lens=LensErrors(),
        lamp_aperture=None,
        background_z_um=None,
        treatment="blend",
        tolerance_um=10 ** rng.uniform(-1.9, 0.0),
        tolerance_theta_rad=10 ** rng.uniform(-2.7, -1.3)
        if kind == "outline" and rng.random() < 0.6
        else None,
        spread=_spread(rng, scope),
    )
    return Problem(case=_seen(case), chains=_CHAINS[kind])


def _microscope(rng: np.random.Generator) -> Microscope:
    return Microscope(
        aperture=rng.uniform(0.1, 0.42),
        wavelength_um=0.6,
        medium_index=1.0,
        magnification=rng.uniform(5, 20),
        pitch_um=7.5,
        width_px=2 * _HALF_PX,
        height_px=2 * _HALF_PX,
    )


def _outline(rng: np.random.Generator, name: str, reach_um: float) -> Outline:
    """Return the feature, its circle about the origin `reach_um` large."""
    r = reach_um
    if name == "disc":
        return disc(r)
    if name == "bore":  # in a plate that fills the region
        side = 8 * _HALF_PX * r
        plate = rectangle(-side, -side, side, side)
        return Outline(rings=(*plate.rings, circle(r, hole=True)))
    if name == "bar":
        half = r * rng.uniform(0.3, 0.5)
        long = math.sqrt(r**2 - half**2)
        return rectangle(-long, -half, long, half)
    if name == "ell":
        a, b = r / math.sqrt(2), r * rng.uniform(0.2, 0.4)
        return polygon([(-a, -a), (a, -a), (a, -a + b), (-a + b, -a + b),
                        (-a + b, a), (-a, a)])  # fmt: skip
    turns = np.sort(rng.uniform(-0.4, 0.4, 3)) + np.array([0.0, 2.0, 4.2])
    return polygon([(r * math.cos(t), r * math.sin(t)) for t in turns])


def _neighbour(
    rng: np.random.Generator, reach_um: float, scope: Microscope
) -> tuple[Layer, ...]:
    """Return a strip beside the feature, or nothing."""
    if rng.random() < 0.5:
        return ()
    near = reach_um + rng.uniform(4, 10) * scope.um_per_px
    strip = rectangle(near, -3 * near, 2 * near, 3 * near)
    return (
        Layer(
            name="neighbour",
            outline=place(strip, 0.0, 0.0, rng.uniform(-math.pi, math.pi)),
            z_um=rng.uniform(0.5, 15),
            reflectance=rng.uniform(0.05, 0.85),
        ),
    )


def _spread(rng: np.random.Generator, scope: Microscope) -> TrialSpread:
    """Return spreads from hardly any to as much as a look stands."""
    pixel, much = scope.um_per_px, rng.uniform(0, 1)
    gain = rng.uniform(0, 0.3) * much
    return TrialSpread(
        focus_sigma_um=float(rng.uniform(0, 5) * much),
        magnification_sigma=float(rng.uniform(0, 0.01) * much),
        light_gain=(1 - gain, 1 + gain),
        light_gradient=(0.0, float(rng.uniform(0, 0.3) * much)),
        pose_sigma_xy_um=float(rng.uniform(0.5, 1.2) * pixel),
        pose_sigma_theta_rad=float(rng.uniform(0.01, 0.08)),
        search_um=float(rng.uniform(3, 4) * pixel),
        occluder_sigma_um=float(rng.uniform(0, 0.5) * much * pixel),
        noise=(1.0, 1 + float(rng.uniform(0, 1) * much)),
    )


def _target(kind: TargetKind, reach_um: float, *, bright: bool) -> Target:
    """Return the target, its pixels still to be filled in."""
    name = "radius_um" if kind == "circle" else "extent_um"
    return Target(
        name="part",
        kind=kind,
        column=0.0,
        row=0.0,
        theta_rad=0.0,
        px_per_um=1.0,
        search_px=0.0,
        theta_range_rad=0.0,
        symmetry=1,
        bright=bright,
        parameters={name: reach_um},
    )


def _seen(case: LookCase) -> LookCase:
    """Return the case, its target where its pose puts it."""
    column, row = case.frame.to_pixel(case.x_um, case.y_um)
    k = case.microscope.px_per_um
    return replace(
        case,
        target=replace(
            case.target,
            column=column,
            row=row,
            theta_rad=case.theta_rad,
            px_per_um=k,
            search_px=k * case.spread.search_um,
            theta_range_rad=3 * case.spread.pose_sigma_theta_rad,
        ),
    )
