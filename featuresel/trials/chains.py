"""Chains of routines worth trying on a target, from what the routines declare."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from microplan.featuresel.routines.contract import (
    PoseTerm,
    Principle,
    Routine,
    Target,
)
from microplan.featuresel.routines.registry import REGISTRY, load
from microplan.optics.outline.tolerant_order import ordered

Chain = tuple[str, ...]

MOST_CHAINS = 16  # a target: every chain is tried on every trial's image
_ANGLES = 3  # places that a routine for the angle alone is tried behind
_SPECIAL = 2  # kinds of target that a special routine looks for, at most
# px; a threshold's centroid is good to .5 px, three times that has to fit: what
# captures less needs a finer start than routines that search give
_SEEDED_PX = 1.5

# lengths from the reference point that an angle acts on, first found first used
_LEVERS = ("outer_um", "radius_um", "extent_um", "reach_um", "length_um", "opening_um")


def chains(
    target: Target,
    *,
    costs: Mapping[str, float] | None = None,
    controls: bool = False,
) -> tuple[Chain, ...]:
    """Return the chains to try on `target`, in a fixed order.

    1. Each routine that needs nothing and gives the position, alone.
    2. Routines for the angle alone, behind the cheapest of those that lack it. Of a
       target with an angle, chains are tried with and without it, because the trials
       decide whether it is needed.
    3. Each routine that needs a start, from coarse to fine: at the nominal position if
       that is sure to be within its capture range, else behind the cheapest chain that
       gives what it needs, with the angle if it gives one too.
    4. Those of step 3 that give the angle too, if there is one, behind a second chain,
       which begins with another routine.
    5. A special routine of step 1 behind the cheapest two that look for more kinds of
       target: it starts nearer, and on the right thing.

    Parameters
    ----------
    target : Target
        What is to be found.
    costs : mapping of str to float, optional
        Work of one `measure` by routine, as `Routine.cost` predicts it for the look. A
        routine missing here is left out: it could not be prepared. Without `costs` a
        routine counts as more expensive the more it gives, the fewer kinds it looks for
        (the special ones are the finer ones), and if it searches.
    controls : bool
        Whether routines known to be bad are tried too, one chain each, at the end.
    """
    names = routines(target, controls=True)
    if costs is None:
        costs = {name: _assumed_cost(load(name)) for name in names}
    price = {name: costs[name] for name in names if name in costs}
    plan = _Plan(target=target, price=price)
    found = plan.chains([n for n in plan.names if not load(n).baseline])[:MOST_CHAINS]
    if not controls:
        return found
    bad = [name for name in plan.names if load(name).baseline]
    return found + tuple(c for name in bad for c in plan.leading_to(name, found)[:1])


def routines(target: Target, *, controls: bool = False) -> tuple[str, ...]:
    """Return the routines that chains for `target` may use, by name.

    They look for its kind and give its position, or its angle if it has one. What needs
    the focus to be known starts from an earlier image, not from another routine.
    """
    useful = {"xy", "theta"} if has_angle(target) else {"xy"}
    return tuple(
        name
        for name in sorted(REGISTRY)
        if target.kind in load(name).kinds
        and useful & set(load(name).provides)
        and "z" not in load(name).requires
        and (controls or not load(name).baseline)
    )


def has_angle(target: Target) -> bool:
    """Return whether the target's angle is observable within its declared range.

    Circles have none. A pattern that repeats has one if a notch breaks the symmetry, or
    if half a period is wider than the range, so that no two angles look alike.
    """
    if target.kind == "circle" or target.symmetry == 0:
        return False
    if "notch_rad" in target.parameters:
        return True
    order = max(target.symmetry, int(target.parameters.get("count", 1.0)))
    return order == 1 or target.theta_range_rad < math.pi / order


def principle(chain: Chain) -> Principle:
    """Return the principle of the last routine of a chain that gives the position."""
    last = [name for name in chain if "xy" in load(name).provides] or list(chain)
    return load(last[-1]).principle


@dataclass(frozen=True, slots=True)
class _Plan:
    """What chains for one target are made of."""

    target: Target
    price: Mapping[str, float]

    @property
    def names(self) -> list[str]:
        """Return the routines, the cheapest first, then by name."""
        return ordered(sorted(self.price), self.price.__getitem__)

    def chains(self, names: Sequence[str]) -> tuple[Chain, ...]:
        """Return the chains made of `names`, in the order that `chains` states."""
        seeds = [n for n in names if not load(n).requires and "xy" in load(n).provides]
        rest = [name for name in names if name not in seeds]
        rest.sort(key=lambda name: (-load(name).capture_px, name))  # coarse to fine
        found: list[Chain] = [(name,) for name in seeds]
        pairs = self._pairs(seeds)
        for name in (n for n in rest if "xy" not in load(n).provides):
            found += self._turned(name, found + pairs)
        wanted = {"xy", "theta"} if has_angle(self.target) else {"xy"}
        second: list[Chain] = []
        for name in (n for n in rest if "xy" in load(n).provides):
            first, *others = self.leading_to(name, found) or [()]
            found += [first] if first else []
            if wanted <= set(load(name).provides):
                second += [c for c in others if c[0] != first[0]][:1]
        return tuple(dict.fromkeys(found + second + pairs))

    def leading_to(self, name: str, before: Sequence[Chain]) -> list[Chain]:
        """Return the chains that end in `name`, each behind one of `before`.

        The likeliest first, which are the cheapest, those with an angle before others.
        """
        routine = load(name)
        missing = self._missing(routine.requires, routine.capture_px)
        if not missing:
            return [(name,)]
        able = [c for c in before if missing <= self._given(c) and name not in c]
        if routine.capture_px < _SEEDED_PX:
            fine = [c for c in able if math.isfinite(self._capture_px(c))]
            able = fine or able
        if "theta" in routine.provides and self._missing(
            ("theta",), routine.capture_px
        ):
            turned = [c for c in able if "theta" in self._given(c)]
            able = self._by_price(turned) + self._by_price(set(able) - set(turned))
        else:
            able = self._by_price(able)
        return [(*chain, name) for chain in able]

    def _turned(self, name: str, before: Sequence[Chain]) -> list[Chain]:
        """Return the chains that end in a routine for the angle alone."""
        lacking = [c for c in before if not set(load(name).provides) <= self._given(c)]
        return [(*chain, name) for chain in self._by_price(lacking)[:_ANGLES]]

    def _pairs(self, seeds: Sequence[str]) -> list[Chain]:
        """Return special routines behind the two cheapest of the more general ones."""
        return [
            (first, then)
            for then in seeds
            if _kinds(then) <= _SPECIAL
            for first in [n for n in seeds if _kinds(n) > _kinds(then)][:2]
        ]

    def _missing(self, needs: Sequence[PoseTerm], capture_px: float) -> set[PoseTerm]:
        """Return what of `needs` the nominal pose does not give."""
        reach = {
            "xy": self.target.search_px,
            "theta": self.target.theta_range_rad * _lever_px(self.target),
        }
        return {known for known in needs if reach.get(known, math.inf) > capture_px}

    def _given(self, chain: Chain) -> set[PoseTerm]:
        """Return what the chain's routines give together."""
        return {known for name in chain for known in load(name).provides}

    def _by_price(self, chains: Iterable[Chain]) -> list[Chain]:
        """Return chains by price, then length, then name."""
        return sorted(
            chains, key=lambda c: (sum(self.price[name] for name in c), len(c), c)
        )

    def _capture_px(self, chain: Chain) -> float:
        """Return the capture range of the last routine that gives the position."""
        placing = [name for name in chain if "xy" in load(name).provides]
        return load(placing[-1]).capture_px


def _kinds(name: str) -> int:
    """Return how many kinds of target a routine looks for."""
    return len(load(name).kinds)


def _assumed_cost(routine: Routine) -> float:
    """Return a stand-in for the cost of a routine that is not prepared yet."""
    work = len(routine.provides) + 1 / len(routine.kinds)
    return work / 3 if routine.requires else work  # what starts near searches less


def _lever_px(target: Target) -> float:
    """Return how far from the reference point an angle acts, 0 if it has none."""
    if not has_angle(target):
        return 0.0
    lengths = (target.parameters.get(name) for name in _LEVERS)
    return next((x for x in lengths if x is not None), 0.0) * target.px_per_um
