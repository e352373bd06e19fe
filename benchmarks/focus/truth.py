"""Focus sweeps whose height is known, and the least that their height can err by.

A gear of 100 um and a post of 44 um, m = 6.9, A = .42, .6 um, 10 ke-, 10 e-, 8 bit.
Pose and angle are drawn, the light too: one level a sweep, and 2 % from image to image.
The blur laws are the exact one and Stokseth's in turn.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.lens.sensor import Sensor, expose, to_unit
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.render import render_stack
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from tests.optics.shapes import disc, gear

LAWS = ("exact", "stokseth")
SENSOR = Sensor(full_well_e=10_000, read_noise_e=10, bits=8)
_MICROSCOPE = Microscope(
    aperture=0.42,
    wavelength_um=0.6,
    medium_index=1.0,
    magnification=6.9,
    pitch_um=7.5,
    width_px=640,
    height_px=480,
)
_FIELD_UM = 174.0  # room for the gear's blur 40 um out of focus
_LEVELS = (0.8, 1.1)  # of the light, one a sweep
_FLICKER = 0.02  # of the light from image to image, one standard deviation
_STEP_UM, _STEP_RAD = 0.05, 1e-3  # of finite differences


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """What is looked at, its top at z = 0."""

    outline: Outline
    reflectance: float
    background: float
    turns: bool  # whether its angle shows


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Where it stands."""

    x_um: float = 0.3
    y_um: float = -0.2
    theta_rad: float = 0.1


PARTS: Mapping[str, Part] = {
    "gear": Part(outline=gear(), reflectance=0.8, background=0.1, turns=True),
    "post": Part(outline=disc(22.0), reflectance=0.75, background=0.15, turns=False),
}


def still(
    part: Part,
    z_um: FloatArray,
    *,
    law: str = "exact",
    pose: Pose = Pose(),
    magnification: float = _MICROSCOPE.magnification,
) -> FloatArray:
    """Return images of 174 x 174 um without noise, (planes, rows, columns)."""
    side = 2 * round(_FIELD_UM / 2 * magnification / _MICROSCOPE.pitch_um)
    outline = place(part.outline, pose.x_um, pose.y_um, pose.theta_rad)
    layer = Layer(name="part", outline=outline, z_um=0.0, reflectance=part.reflectance)
    return render_stack(
        Scene(layers=(layer,), background=part.background),
        replace(_MICROSCOPE, magnification=magnification),
        focus_um=tuple(float(z) for z in z_um),
        model=law,
        window=Window(
            row=240 - side // 2, column=320 - side // 2, rows=side, columns=side
        ),
    )


def draw_pose(rng: np.random.Generator) -> Pose:
    """Return a pose within a micrometre at any angle."""
    x, y = rng.uniform(-1, 1, 2)
    return Pose(x_um=x, y_um=y, theta_rad=rng.uniform(-math.pi, math.pi))


def sweep(
    part: Part, z_um: FloatArray, law: str, rng: np.random.Generator
) -> FloatArray:
    """Return a sweep's images as the camera would give them without noise."""
    level = rng.uniform(*_LEVELS)
    light = level * (1 + _FLICKER * rng.standard_normal(len(z_um)))
    return still(part, z_um, law=law, pose=draw_pose(rng)) * light[:, None, None]


def noisy(image: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return what the camera gives."""
    return to_unit(expose(image, SENSOR, rng), SENSOR.bits)


def limit_um(part: Part, z_um: FloatArray) -> float:
    """Return the Cramer-Rao limit of z from a whole sweep.

    Pose and angle are unknown and shared by all images, the light is unknown in each.
    """
    mean, step = still(part, z_um), _STEP_UM
    ends = [
        (still(part, z_um - step), still(part, z_um + step)),
        (
            still(part, z_um, pose=_moved(x_um=step)),
            still(part, z_um, pose=_moved(x_um=-step)),
        ),
        (
            still(part, z_um, pose=_moved(y_um=step)),
            still(part, z_um, pose=_moved(y_um=-step)),
        ),
    ]
    if part.turns:
        ahead, behind = (_moved(theta_rad=s * _STEP_RAD) for s in (1, -1))
        ends.append((still(part, z_um, pose=ahead), still(part, z_um, pose=behind)))
    slopes = [(first - last) / (2 * step) for first, last in ends]
    full, top = SENSOR.full_well_e, SENSOR.top_count
    variance = mean / full + (SENSOR.read_noise_e / full) ** 2 + 1 / (12 * top**2)
    information = np.zeros((len(slopes), len(slopes)))
    for i, light in enumerate(mean):
        rows = np.stack([s[i] for s in slopes]) / np.sqrt(variance[i])
        rows = rows.reshape(len(slopes), -1)
        own = (light / np.sqrt(variance[i])).ravel()
        rows = rows - np.outer(rows @ own / (own @ own), own)
        information += rows @ rows.T
    return math.sqrt(float(np.linalg.inv(information)[0, 0]))


def _moved(*, x_um: float = 0.0, y_um: float = 0.0, theta_rad: float = 0.0) -> Pose:
    """Return the nominal pose displaced."""
    at = Pose()
    return Pose(
        x_um=at.x_um + x_um, y_um=at.y_um + y_um, theta_rad=at.theta_rad + theta_rad
    )
