"""Smallest set of features that determines a part's pose well enough."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import combinations

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.sets.pose_covariance import (
    FeatureMeasurement,
    PoseAccuracy,
    PoseRequirement,
    information,
    jacobian,
    known,
)
from microplan.optics.outline.tolerant_order import above, at_most, least, ordered

_MORE = 2  # features more than allowed that relaxations are tried with
_ROUND = 1.001  # limits are said with three digits and have to hold

Changes = tuple[tuple[str, float], ...]  # of a need, by its field


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureSet:
    """A set of features, best first as they were taken, and its standing."""

    names: tuple[str, ...]
    known: PoseAccuracy
    # with the worst feature dropped; infinite for a single one
    dropped_um: float
    dropped_theta_rad: float
    cost: float
    qualifies: bool
    reasons: tuple[tuple[str, str], ...]  # per feature, in the order given
    relaxations: tuple[str, ...]  # each is enough; or what is missing; () if it is good


def choose_set(
    measured: Sequence[FeatureMeasurement], need: PoseRequirement
) -> FeatureSet:
    """Return the smallest set that is good enough, the most telling of its size.

    For each size from one up, features are taken greedily by the determinant of the
    pose's covariance, rotation scaled by the part's radius, then exchanged one by one
    while that gets smaller. Within `MARGIN` the cheaper wins, then the first by name.
    If the best set of a size fails, exchanges that bring it nearer to the limits
    follow. If no size is good enough, the set that comes nearest is returned with what
    to relax.

    Deviations of features are taken as independent: what moves all of them together, as
    a shift of the whole image does, is none of them and belongs to the error budget.

    Parameters
    ----------
    measured : sequence of FeatureMeasurement
        At least one; names differ.
    need : PoseRequirement
        Limits of the set.

    Raises
    ------
    ValueError
        If there is no one or two share a name.

    References
    ----------
    D-optimal design with exchanges: Fedorov (1972), Mitchell (1974). The criteria of
    resolution and conditioning: Feddema, Lee & Mitchell (1991).
    """
    names = [one.name for one in measured]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"measured must have names that differ, got {names}")
    search = SetSearch.of(measured, need)
    return _result(search, search.chosen())


def _result(search: SetSearch, taken: tuple[int, ...]) -> FeatureSet:
    """Return the set with its standing."""
    found, dropped = search.known(taken), search.dropped(taken)
    qualifies = at_most(search.excess(taken), 1)
    return FeatureSet(
        names=tuple(search.measured[k].name for k in taken),
        known=found,
        dropped_um=max(d.sigma_um for d in dropped),
        dropped_theta_rad=max(d.sigma_theta_rad for d in dropped),
        cost=search.cost(taken),
        qualifies=qualifies,
        reasons=tuple(
            (one.name, _reason(search, k, taken))
            for k, one in enumerate(search.measured)
        ),
        relaxations=() if qualifies else _relaxations(search, taken),
    )


def _reason(search: SetSearch, place: int, taken: tuple[int, ...]) -> str:
    """Return why a feature is in the set or not, with numbers."""
    one, with_all = search.measured[place], search.known(taken)
    if place in taken:
        rest = search.known([k for k in taken if k != place])
        return f"taken: without it {_said(search, rest)}"
    if not jacobian([one], search.need.radius_um).any():
        return "left out: it tells nothing of the pose"
    more = search.known((*taken, place))
    if len(taken) < search.need.most:
        return (
            f"left out: with it {_said(search, more)} instead of "
            f"{_said(search, with_all)}, for cost {one.cost:.3g}"
        )
    ways = [(*taken[:at], place, *taken[at + 1 :]) for at in range(len(taken))]
    ranks = [-value for value in search.log_dets(ways).tolist()]
    instead = ways[least(range(len(ways)), ranks.__getitem__, scale=1.0)]
    return (
        f"left out: in place of {_swapped(search, taken, instead)} "
        f"{_said(search, search.known(instead))} instead of {_said(search, with_all)}"
    )


def _swapped(search: SetSearch, taken: Sequence[int], instead: Sequence[int]) -> str:
    """Return the name of the feature that an exchange takes out."""
    return search.measured[next(k for k in taken if k not in instead)].name


def _said(search: SetSearch, found: PoseAccuracy) -> str:
    """Return the sigmas in words."""
    words = f"sigma is {found.sigma_um:.3g} um"
    if search.need.sigma_theta_rad is not None:
        words += f" and {found.sigma_theta_rad:.3g} rad"
    return words


def _relaxations(search: SetSearch, taken: tuple[int, ...]) -> tuple[str, ...]:
    """Return what would let a set qualify: one change each, or two where one is none.

    Every way is tried. If none does, what is missing is said.
    """
    ways = _ways(search, taken)
    for together in (1, 2):
        enough = [
            " and ".join(words for words, _ in some)
            for some in combinations(ways, together)
            if _would_do(search, {k: v for _, change in some for k, v in change})
        ]
        if enough:
            return tuple(enough)
    return _missing(search)


def _ways(search: SetSearch, taken: tuple[int, ...]) -> list[tuple[str, Changes]]:
    """Return changes of the limits, in words and as they are."""
    need, found = search.need, search.known(taken)
    dropped = search.dropped(taken) if need.redundant else []
    ways: list[tuple[str, Changes]] = []
    if need.redundant:
        ways.append(("a set that needs all its features", (("redundant", False),)))
    more = min(need.most + _MORE, len(search.measured))
    if more > need.most:
        ways.append((f"up to {more} features", (("most", more),)))
    if need.conditioning < found.conditioning < math.inf:
        limit = found.conditioning * _ROUND
        ways.append((f"conditioning up to {limit:.3g}", (("conditioning", limit),)))
    # as the set is, and as it is without its best feature
    for some in ([found], [found, *dropped]):
        way = _looser(need, some)
        if way not in ways and way[1]:
            ways.append(way)
    return ways


def _looser(need: PoseRequirement, some: Sequence[PoseAccuracy]) -> tuple[str, Changes]:
    """Return the sigmas that all of `some` meet; no change if those are infinite."""
    place = max(known.sigma_um for known in some) * _ROUND
    turn = max(known.sigma_theta_rad for known in some) * _ROUND
    changes: list[tuple[str, float]] = []
    words = []
    if need.sigma_um < place < math.inf:
        changes.append(("sigma_um", place))
        words.append(f"sigma up to {place:.3g} um")
    wanted = need.sigma_theta_rad
    if wanted is not None and wanted < turn < math.inf:
        changes.append(("sigma_theta_rad", turn))
        words.append(f"sigma up to {turn:.3g} rad")
    return " and ".join(words), tuple(changes)


def _would_do(search: SetSearch, changes: Mapping[str, float]) -> bool:
    """Return whether a set qualifies under other limits."""
    limits = {f.name: getattr(search.need, f.name) for f in fields(search.need)}
    search = replace(search, need=PoseRequirement(**{**limits, **changes}))
    return at_most(search.excess(search.chosen()), 1)


def _missing(search: SetSearch) -> tuple[str, ...]:
    """Return what no feature tells."""
    found = search.known(range(len(search.measured)))
    missing = []
    if math.isinf(found.sigma_um):
        missing.append("a feature that tells the other direction of the place")
    if search.need.sigma_theta_rad is not None and math.isinf(found.sigma_theta_rad):
        missing.append("a feature that tells the angle, or one farther away")
    return tuple(missing) or ("a second feature for whatever is told once",)


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

    def known(self, taken: Sequence[int]) -> PoseAccuracy:
        """Return how well some features determine the pose."""
        return known([self.measured[k] for k in taken], self.need)

    def log_dets(self, ways: Sequence[Sequence[int]]) -> FloatArray:
        """Return log det of the information of sets of one size, (N,), per um^2.

        Of blind sets as if a little were known.

        It ranks blind sets by what they do tell; without an unwanted angle it is the
        log det of the Schur complement.
        """
        need = self.need
        matrices = self.matrices[np.array(ways)].sum(axis=1)
        matrices = matrices + np.eye(3) * (_FAR * need.radius_um) ** -2
        ranks: FloatArray = np.linalg.slogdet(matrices)[1]
        if need.sigma_theta_rad is None:  # det of what is left without the angle
            ranks = ranks - np.log(matrices[:, 2, 2])
        return ranks

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
        ranks = self.log_dets(ways).tolist()
        near = [way for way, t in zip(ways, ranks, strict=True)
                if at_most(max(ranks), t + MARGIN, scale=1.0)]  # fmt: skip
        return least(near, self.cost)
