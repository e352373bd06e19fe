"""A routine that costs nothing: it always finds the target at the stated distance."""

from __future__ import annotations

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Routine,
    Target,
)


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


NULL = Routine(
    name="null",
    version="1",
    kinds=("circle",),
    principle="area",
    provides=("xy",),
    baseline=True,
    prepare=prepare,
    measure=measure,
    cost=cost,
)
