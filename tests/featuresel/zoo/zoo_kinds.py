"""What an animal of the zoo is made of: a routine from two functions."""

from __future__ import annotations

import math

from microplan.featuresel.routines.contract import (
    Measure,
    Measurement,
    PoseTerm,
    Prepare,
    Routine,
    TargetKind,
)


def animal(
    *,
    name: str,
    kind: TargetKind,
    prepare: Prepare,
    measure: Measure,
    provides: tuple[PoseTerm, ...] = ("xy",),
    requires: tuple[PoseTerm, ...] = (),
    capture_px: float = math.inf,
) -> Routine:
    """Return a routine that must not be chosen; its functions are what is wrong.

    Its cost is so low that only its faults speak against it.
    """
    return Routine(
        name=name,
        version="1",
        kinds=(kind,),
        principle="area",
        provides=provides,
        requires=requires,
        capture_px=capture_px,
        baseline=True,
        prepare=prepare,
        measure=measure,
        cost=lambda _artifact, _pixels: 0.01,
    )


def answer(column: float, row: float, theta_rad: float | None = None) -> Measurement:
    """Return a measurement that is sure of itself, as the animals are."""
    return Measurement(
        column=float(column),
        row=float(row),
        theta_rad=theta_rad,
        score=1.0,
        spread_px=0.1,
    )
