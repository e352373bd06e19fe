"""Looks that fits are tried on, prepared once, and the limits of what they can find."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import NominalRender, nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact, Guess
from microplan.featuresel.routines.likelihood import defocus_pair, likelihood
from microplan.featuresel.routines.likelihood.appearance import ImagePose
from microplan.featuresel.routines.likelihood.comparison import (
    DefocusedImage,
    ImageComparison,
)
from microplan.featuresel.routines.likelihood.fit_problem import read_job
from tests.featuresel.conftest import CASES, noisy

PAIR_UM = 8.0  # offset of both images of a pair
# steps of the differences that slopes are taken by: small against the resolution,
# 1.4 um, and the depth of field, 3.4 um
_STEPS = {
    "dx_um": 0.05, "dy_um": 0.05, "theta_rad": 1e-3, "dz_um": 0.05, "zoom": 1e-3,
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """Where a target was put."""

    dx_um: float = 0.0
    dy_um: float = 0.0
    theta_rad: float = 0.0
    dz_um: float = 0.0
    zoom: float = 1.0

    def render(self, look: NominalRender, *, offset_um: float = 0.0) -> FloatArray:
        """Return its image, `offset_um` off its focus."""
        return look(
            dx_um=self.dx_um,
            dy_um=self.dy_um,
            theta_rad=self.theta_rad,
            dz_um=self.dz_um + offset_um,
            zoom=self.zoom,
        )

    def pose(self, case: LookCase) -> ImagePose:
        """Return where that is in the region."""
        column, row = case.frame.to_pixel(
            case.x_um + self.dx_um, case.y_um + self.dy_um
        )
        middle = case.frame.to_pixel(0.0, 0.0)
        return ImagePose(
            column=middle[0] + (column - middle[0]) * self.zoom,
            row=middle[1] + (row - middle[1]) * self.zoom,
            turn_rad=self.theta_rad,
            z_um=self.dz_um,
            zoom=self.zoom,
        )


@cache
def case(name: str) -> LookCase:
    """Return a look of `conftest`, or the gear's far out of focus."""
    if name == "far_gear":  # beyond the first sign change of the teeth, at 20.6 um
        gear = CASES["find_gear"]()
        spread = replace(gear.spread, focus_sigma_um=1.0)
        return replace(gear, key=name, focus_um=25.0, spread=spread)
    return CASES[name]()


@cache
def render(name: str) -> NominalRender:
    return nominal_render(case(name))


@cache
def artifact(name: str) -> Artifact:
    made = likelihood.LIKELIHOOD.prepare(render(name), case(name).target)
    assert isinstance(made, Artifact), made
    return made


@cache
def pair_artifact(name: str) -> Artifact:
    made = defocus_pair.prepare(render(name), case(name).target, offset_um=PAIR_UM)
    assert isinstance(made, Artifact), made
    return made


def job(name: str, image: FloatArray) -> ImageComparison:
    return read_job((DefocusedImage(image=image),), artifact(name))


def draw(name: str, rng: np.random.Generator, *, z_um: float = 0.0) -> Drawn:
    """Return a pose anywhere within 6 um, and turned by anything where it may be."""
    dx, dy = rng.uniform(-6, 6, 2)
    turn = rng.uniform(-math.pi, math.pi) if case(name).theta_any else 0.0
    return Drawn(dx_um=dx, dy_um=dy, theta_rad=turn, dz_um=z_um)


def photo(name: str, drawn: Drawn, rng: np.random.Generator) -> FloatArray:
    """Return a noisy image."""
    return noisy(case(name), drawn.render(render(name)), rng)


def near(pose: ImagePose, *, column: float = 0.0, row: float = 0.0) -> Guess:
    """Return a guess off the true place, that knows nothing else."""
    return Guess(column=pose.column + column, row=pose.row + row)


def limits(
    name: str,
    drawn: Drawn,
    free: Sequence[str],
    *,
    offsets_um: Sequence[float] = (0.0,),
) -> Mapping[str, float]:
    """Return the Cramer-Rao bounds of the free numbers, gain and gradients unknown.

    By central differences of the renderer, images of all offsets together.
    """
    look, shown, total = render(name), case(name), np.zeros((len(free) + 3,) * 2)
    rows, columns = np.mgrid[: shown.window.rows, : shown.window.columns]
    for offset in offsets_um:
        mean = drawn.render(look, offset_um=offset)
        slopes = [_slope(look, drawn, key, offset) for key in free]
        slopes += [mean, mean * (columns / columns.size), mean * (rows / rows.size)]
        scores = np.stack(slopes) / np.sqrt(look.camera.variance(mean))
        scores = scores.reshape(len(slopes), -1)
        total += scores @ scores.T
    sigmas = np.sqrt(np.diag(np.linalg.inv(total)))
    return dict(zip(free, sigmas.tolist(), strict=False))


def _slope(look: NominalRender, drawn: Drawn, key: str, offset_um: float) -> FloatArray:
    step, value = _STEPS[key], getattr(drawn, key)
    high = replace(drawn, **{key: value + step}).render(look, offset_um=offset_um)
    low = replace(drawn, **{key: value - step}).render(look, offset_um=offset_um)
    slope: FloatArray = (high - low) / (2 * step)
    return slope
