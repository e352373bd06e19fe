"""What an animal of the zoo is made of: a routine from two functions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

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

Prepare = Callable[[LookModel, Target], Artifact | Failure]
Measure = Callable[[FloatArray, Artifact, Guess], Measurement | Failure]


@dataclass(frozen=True, kw_only=True)
class Animal:
    """A routine that must not be chosen; its functions are what is wrong with it."""

    NAME: str
    KINDS: tuple[TargetKind, ...]
    make: Prepare
    read: Measure
    PROVIDES: tuple[PoseTerm, ...] = ("xy",)
    REQUIRES: tuple[PoseTerm, ...] = ()
    CAPTURE_PX: float = math.inf
    VERSION: str = "1"
    BASELINE: bool = True

    def prepare(self, render: LookModel, target: Target) -> Artifact | Failure:
        """Return what `measure` needs."""
        return self.make(render, target)

    def measure(
        self, image: FloatArray, artifact: Artifact, guess: Guess
    ) -> Measurement | Failure:
        """Return what the animal says."""
        return self.read(image, artifact, guess)

    def cost(self, _artifact: Artifact, _pixels: int) -> float:
        """Return a cost so low that only its faults speak against it."""
        return 0.01


def answer(column: float, row: float, theta_rad: float | None = None) -> Measurement:
    """Return a measurement that is sure of itself, as the animals are."""
    return Measurement(
        column=float(column),
        row=float(row),
        theta_rad=theta_rad,
        score=1.0,
        spread_px=0.1,
    )
