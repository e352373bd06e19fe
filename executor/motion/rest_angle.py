"""Rest angle of a part between closing jaws, with the probability of another one."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.schemas.plan import RestAngle


@dataclass(frozen=True, slots=True, kw_only=True)
class Squeezed:
    """How a part comes to rest between closing jaws, in the tool's frame."""

    theta_rad: float  # the rest angle nearest to the angle before
    across_um: float  # of its origin then, from the middle of the jaws
    sigma_rad: float  # rms deviation from that angle
    elsewhere: float  # probability of another rest angle


def squeezed(
    rests: Sequence[RestAngle], theta_rad: float, sigma_rad: float
) -> Squeezed:
    """Return where closing jaws turn a part.

    Parameters
    ----------
    rests : sequence of RestAngle
        All within one turn; at least one.
    theta_rad, sigma_rad : float
        Of the part's angle before, in the tool's frame: normal about `theta_rad`. Each
        start goes to the rest angle nearest to it.

    Raises
    ------
    ValueError
        If `rests` is empty.
    """
    if not rests:
        raise ValueError("rests must hold an angle: without one no jaw turns the part")
    ends = sorted(
        (math.remainder(rest.theta_rad - theta_rad, math.tau) + turn, rest.across_um)
        for rest in rests
        for turn in (-math.tau, 0.0, math.tau)
    )
    turns = [turn for turn, _ in ends]
    cuts = [(a + b) / 2 for a, b in itertools.pairwise(turns)]
    below = [0.0, *(_below(cut, sigma_rad) for cut in cuts), 1.0]
    chances = [high - low for low, high in itertools.pairwise(below)]
    turn, across_um = min(ends, key=lambda end: abs(end[0]))
    off = [(p, t - turn) for p, t in zip(chances, turns, strict=True) if t != turn]
    return Squeezed(
        theta_rad=theta_rad + turn,
        across_um=across_um,
        sigma_rad=math.sqrt(sum(p * by_rad**2 for p, by_rad in off)),
        elsewhere=sum(p for p, _ in off),
    )


def _below(offset_rad: float, sigma_rad: float) -> float:
    """Return the probability that a normal deviation is below `offset_rad`."""
    if sigma_rad <= 0:
        return float(offset_rad > 0)
    return math.erfc(-offset_rad / sigma_rad / math.sqrt(2)) / 2
