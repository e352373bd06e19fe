"""Run routines coarse to fine, each starting where the one before ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from featuresel.routines import (
    Artifact,
    Failure,
    FloatArray,
    Guess,
    Measurement,
    load,
)


def measure_chain(
    image: FloatArray, stages: Sequence[tuple[str, Artifact]], start: Guess
) -> Measurement | Failure:
    """Return the last stage's measurement, with the angle of whoever measured one.

    Parameters
    ----------
    image : (rows, columns) float64 array
        The look's region, 0..1 of full scale.
    stages : sequence of (routine name, artifact)
        Coarse to fine; at least one.
    start : Guess
        The nominal place, px of the region.

    Returns
    -------
    Measurement or Failure
        The first failure ends the chain.

    Raises
    ------
    ValueError
        If `stages` is empty.
    """
    if not stages:
        raise ValueError("a chain needs at least one routine")
    guess = start
    theta_rad: float | None = None
    found: Measurement | Failure
    for name, artifact in stages:
        found = load(name).measure(image, artifact, guess)
        if isinstance(found, Failure):
            return Failure(code=found.code, message=f"{name}: {found.message}")
        theta_rad = theta_rad if found.theta_rad is None else found.theta_rad
        guess = Guess(
            column=found.column,
            row=found.row,
            theta_rad=start.theta_rad if theta_rad is None else theta_rad,
        )
    assert isinstance(found, Measurement)  # noqa: S101 - a type narrowing, not a check
    return replace(found, theta_rad=theta_rad)
