"""Greedy choice and exchange: the most telling set of a size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.sets.pose_covariance import (
    FeatureMeasurement,
    PoseAccuracy,
    PoseRequirement,
    information,
    known,
)
from microplan.optics.outline.tolerant_order import above, at_most, least, ordered

MARGIN = 0.02  # of log det: a hundredth of every sigma is no reason to pay more
_FAR = 1e3  # radii: a pose known so badly is not known
_SWEEPS = 20  # of exchanges: two are enough but for ties


@dataclass(frozen=True, slots=True)
class SetSearch:
    """Choice among some features; sets are tuples of their indices."""

    measured: tuple[FeatureMeasurement, ...]
    need: PoseRequirement
    matrices: FloatArray  # (N, 3, 3) the information of each

    @classmethod
    def of(
        cls, measured: Sequence[FeatureMeasurement], need: PoseRequirement
    ) -> SetSearch:
        """Return the search among `measured`."""
        matrices = [information([one], need.radius_um) for one in measured]
        return cls(measured=tuple(measured), need=need, matrices=np.array(matrices))

    def chosen(self) -> tuple[int, ...]:
        """Return the smallest set that meets the limits, or what comes nearest."""
        tried = []
        for size in range(1, min(self.need.most, len(self.measured)) + 1):
            taken = self.best_of(size)
            if above(self.excess(taken), 1):
                taken = self.nearer(taken)
            if at_most(self.excess(taken), 1):
                return taken
            tried.append(taken)
        return least(tried, self.excess)  # of sets as near the smallest

    def best_of(self, size: int) -> tuple[int, ...]:
        """Return the most telling set of `size`, greedily and by exchanges.

        Started from the best feature and from every other: two edges may tell much
        together that tell little each.
        """
        starts = [(), *((k,) for k in self._order())]
        ways = [self._settled(self._filled(start, size)) for start in starts]
        return self._best(ways)

    def nearer(self, taken: tuple[int, ...]) -> tuple[int, ...]:
        """Return the set after exchanges that bring it nearer to the limits."""
        for _ in range(_SWEEPS):
            nearest = least([taken, *self._neighbours(taken)], self.excess)
            if nearest == taken:
                break
            taken = nearest
        return taken

    def excess(self, taken: Sequence[int]) -> float:
        """Return the largest of what a set reaches over its limits; 1 just meets."""
        need, found = self.need, self.known(taken)
        shares = [self.share(found), found.conditioning / need.conditioning]
        if need.redundant:
            shares.append(max(map(self.share, self.dropped(taken))))
        return max(shares)

    def some(self, taken: Sequence[int]) -> list[FeatureMeasurement]:
        """Return the features of a set."""
        return [self.measured[k] for k in taken]

    def known(self, taken: Sequence[int]) -> PoseAccuracy:
        """Return how well some features determine the pose."""
        return known(self.some(taken), self.need)

    def tells(self, ways: Sequence[Sequence[int]]) -> FloatArray:
        """Return log det of the information of sets of one size, (N,), per um^2.

        Of blind sets as if a little were known.

        It ranks blind sets by what they do tell; without an unwanted angle it is the
        log det of the Schur complement.
        """
        need = self.need
        matrices = self.matrices[np.array(ways)].sum(axis=1)
        matrices = matrices + np.eye(3) * (_FAR * need.radius_um) ** -2
        told: FloatArray = np.linalg.slogdet(matrices)[1]
        if need.sigma_theta_rad is None:  # det of what is left without the angle
            told = told - np.log(matrices[:, 2, 2])
        return told

    def cost(self, taken: Sequence[int]) -> float:
        """Return the work of measuring a set."""
        return sum(self.measured[k].cost for k in taken)

    def dropped(self, taken: Sequence[int]) -> list[PoseAccuracy]:
        """Return what is known with each feature dropped in turn."""
        return [self.known([k for k in taken if k != out]) for out in taken]

    def share(self, found: PoseAccuracy) -> float:
        """Return the larger sigma over its limit."""
        share = found.sigma_um / self.need.sigma_um
        if self.need.sigma_theta_rad is None:
            return share
        return max(share, found.sigma_theta_rad / self.need.sigma_theta_rad)

    def _order(self) -> list[int]:
        """Return the features, cheapest first, then by name."""
        named = sorted(range(len(self.measured)), key=lambda k: self.measured[k].name)
        return ordered(named, lambda k: self.measured[k].cost)

    def _neighbours(self, taken: tuple[int, ...]) -> list[tuple[int, ...]]:
        """Return the sets with one feature exchanged, in a fixed order."""
        return [
            (*taken[:at], other, *taken[at + 1 :])
            for at in range(len(taken))
            for other in self._order()
            if other not in taken
        ]

    def _filled(self, taken: tuple[int, ...], size: int) -> tuple[int, ...]:
        """Return the set with the feature that tells most added, up to `size`."""
        while len(taken) < size:
            taken = self._best([(*taken, k) for k in self._order() if k not in taken])
        return taken

    def _settled(self, taken: tuple[int, ...]) -> tuple[int, ...]:
        """Return the set after exchanges of one feature, until none is better."""
        for _ in range(_SWEEPS):
            best = self._best([taken, *self._neighbours(taken)])
            if best == taken:
                break
            taken = best
        return taken

    def _best(self, ways: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
        """Return the set that tells most: of all within MARGIN of it the cheapest.

        Of those that cost the same the first.
        """
        told = self.tells(ways).tolist()
        near = [way for way, t in zip(ways, told, strict=True)
                if at_most(max(told), t + MARGIN, scale=1.0)]  # fmt: skip
        return least(near, self.cost)
