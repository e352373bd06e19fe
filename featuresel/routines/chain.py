"""Run routines coarse to fine, each starting where the one before ended."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    Measurement,
    Routine,
)
from microplan.featuresel.routines.picture import refused
from microplan.featuresel.routines.registry import load

HANDOVER_SIGMAS = 3.0  # of the last position must fit into a routine's capture range


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainState:
    """Where a chain stands: the next guess, and what was measured so far."""

    guess: Guess
    found: Measurement | None = None  # None before the first routine


def advance(
    image: FloatArray, name: str, artifact: Artifact, progress: ChainState
) -> ChainState | Failure:
    """Return the chain's state after one more routine, or why that failed.

    `image` is (rows, columns), 0..1 of full scale.

    Angle, focus and zoom are those of the last routine that gave them. A routine that
    does not give the position leaves it and its standard deviation as they were, and
    the score is the lower one. Hand-over is gated: the code is "not_captured" where
    `HANDOVER_SIGMAS` standard deviations of the position before do not fit into the
    routine's capture range. What is no image reaches no routine, see `picture.refused`.
    """
    routine, before = load(name), progress.found
    if before is not None and not _captures(routine, before):
        reach = HANDOVER_SIGMAS * before.spread_px
        message = f"{HANDOVER_SIGMAS:g} spreads of the place before it are {reach:.3g}"
        message += f" px, it captures {routine.capture_px:g} px"
        return Failure("not_captured", f"{name}: {message}")
    found = refused(image) or routine.measure(image, artifact, progress.guess)
    if isinstance(found, Failure):
        return Failure(found.code, f"{name}: {found.message}")
    if before is not None:
        found = _kept(found, before, placed="xy" in routine.provides)
    start = progress.guess
    guess = Guess(
        column=found.column,
        row=found.row,
        theta_rad=start.theta_rad if found.theta_rad is None else found.theta_rad,
        z_um=start.z_um if found.z_um is None else found.z_um,
        zoom=start.zoom if found.zoom is None else found.zoom,
        theta_assumed=start.theta_assumed and found.theta_rad is None,
    )
    return ChainState(guess=guess, found=found)


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
        The nominal position, px of the region.

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
    progress = ChainState(guess=start)
    for name, artifact in stages:
        after = advance(image, name, artifact, progress)
        if isinstance(after, Failure):
            return after
        progress = after
    assert progress.found is not None  # noqa: S101 - stages are not empty
    return progress.found


def _captures(routine: Routine, before: Measurement) -> bool:
    """Return whether what was found is near enough for `routine` to start from."""
    if math.isinf(routine.capture_px):
        return True  # it searches where the target may be
    return HANDOVER_SIGMAS * before.spread_px <= routine.capture_px  # no for a nan


def _kept(found: Measurement, before: Measurement, *, placed: bool) -> Measurement:
    """Return `found` with what only the routine before it could tell.

    `placed` says whether the position is new too.
    """
    if found.theta_rad is None:
        found = replace(
            found,
            theta_rad=before.theta_rad,
            spread_theta_rad=before.spread_theta_rad,
        )
    if found.z_um is None:
        found = replace(
            found,
            z_um=before.z_um,
            spread_z_um=before.spread_z_um,
            z_is_signed=before.z_is_signed,
        )
    if found.zoom is None:
        found = replace(found, zoom=before.zoom)
    if placed:
        return found
    return replace(
        found,
        spread_px=before.spread_px,
        axis_rad=before.axis_rad,
        score=min(found.score, before.score),
    )
