"""A routine that costs nothing: it always finds the target as far off as it is told."""

from __future__ import annotations

import math

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    PoseTerm,
    Target,
    TargetKind,
)

NAME = "null"
VERSION = "1"
KINDS: tuple[TargetKind, ...] = ("circle",)
PROVIDES: tuple[PoseTerm, ...] = ("xy",)
REQUIRES: tuple[PoseTerm, ...] = ()
CAPTURE_PX = math.inf
BASELINE = True
EXPENSIVE = False


def prepare(_render: LookModel, _target: Target) -> Artifact | Failure:
    """Return how far off the target is found, px."""
    return Artifact(parameters={"away_px": 1.0})


def measure(
    _image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the nominal place, shifted; the image is not read."""
    return Measurement(
        column=guess.column + artifact.parameters["away_px"],
        row=guess.row,
        theta_rad=None,
        score=1.0,
        spread_px=0.01,
    )


def cost(_artifact: Artifact, _pixels: int, /) -> float:
    """Return the predicted work: none."""
    return 0.0
