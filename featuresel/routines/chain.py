"""Run routines coarse to fine, each starting where the one before ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from featuresel.routines import (
    Artifact,
    Failure,
    FloatArray,
    Guess,
    Measurement,
    load,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """Where a chain stands: the next guess, and what was measured so far."""

    guess: Guess
    found: Measurement | None = None  # None before the first routine


def advance(
    image: FloatArray, name: str, artifact: Artifact, progress: Progress
) -> Progress | Failure:
    """Return the chain's state after one more routine, or why that failed.

    The angle is that of the last routine that gave one. A routine that does not give
    the place leaves place and spread as they were, and the score is the lower one.
    """
    routine, before = load(name), progress.found
    found = routine.measure(image, artifact, progress.guess)
    if isinstance(found, Failure):
        return Failure(code=found.code, message=f"{name}: {found.message}")
    if before is not None and found.theta_rad is None:
        found = replace(found, theta_rad=before.theta_rad)
    if before is not None and "xy" not in routine.GIVES:
        score = min(found.score, before.score)
        found = replace(found, spread_px=before.spread_px, score=score)
    known = found.theta_rad
    theta_rad = progress.guess.theta_rad if known is None else known
    guess = Guess(column=found.column, row=found.row, theta_rad=theta_rad)
    return Progress(guess=guess, found=found)


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
    progress = Progress(guess=start)
    for name, artifact in stages:
        after = advance(image, name, artifact, progress)
        if isinstance(after, Failure):
            return after
        progress = after
    assert progress.found is not None  # noqa: S101 - stages are not empty
    return progress.found
