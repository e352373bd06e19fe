"""Angles at which flat jaws leave a part, with their probabilities."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

from microplan.optics.outline.tolerant_order import least

TAIL_SIGMAS = 9.0  # beyond, a normal tail is below 1e-18 and a double adds nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class Settling:
    """Angles at which flat jaws may leave a part, each with its probability."""

    nearest_rad: float  # to the angle before
    angles_rad: tuple[float, ...]
    chances: tuple[float, ...]

    @property
    def sigma_rad(self) -> float:
        """Return the rms deviation from the nearest."""
        pairs = zip(self.angles_rad, self.chances, strict=True)
        return math.sqrt(sum(p * (turn - self.nearest_rad) ** 2 for turn, p in pairs))

    @property
    def elsewhere(self) -> tuple[float, float]:
        """Return P(another angle than the nearest), and the likeliest other one."""
        other = {
            turn: chance
            for turn, chance in zip(self.angles_rad, self.chances, strict=True)
            if turn != self.nearest_rad
        }
        return sum(other.values()), max(other, key=lambda turn: other[turn])


def settling(minima: tuple[float, ...], theta_rad: float, sigma_rad: float) -> Settling:
    """Return where an angle settles in one of several minima.

    Parameters
    ----------
    minima : tuple of float
        Angles in [0, pi), repeated every pi; at least one.
    theta_rad, sigma_rad : float
        Of the angle before: normal about `theta_rad`. Each start goes to the minimum
        nearest to it.
    """
    reach = math.ceil(TAIL_SIGMAS * sigma_rad / math.pi) + 1
    base = theta_rad - math.fmod(theta_rad, math.pi)
    angles_rad = sorted(
        base + m + k * math.pi for k in range(-reach, reach + 1) for m in minima
    )
    cuts = [(a + b) / 2 for a, b in itertools.pairwise(angles_rad)]
    below = [0.0, *(_below(cut - theta_rad, sigma_rad) for cut in cuts), 1.0]
    return Settling(
        nearest_rad=least(angles_rad, lambda turn: abs(turn - theta_rad), scale=1.0),
        angles_rad=tuple(angles_rad),
        chances=tuple(high - low for low, high in itertools.pairwise(below)),
    )


def _below(offset_rad: float, sigma_rad: float) -> float:
    """Return the probability that a normal deviation is below `offset_rad`."""
    if sigma_rad <= 0:
        return float(offset_rad > 0)
    return math.erfc(-offset_rad / sigma_rad / math.sqrt(2)) / 2
