"""Chains of routines worth trying on a target, from what the routines declare."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from featuresel.routines import REGISTRY, Known, Routine, Target, load

Chain = tuple[str, ...]

MOST_CHAINS = 16  # a target: every chain is tried on every trial's image
_LED = 2  # chains that lead to a routine that needs a start
_ANGLES = 3  # places that a routine for the angle alone is tried behind

# lengths from the reference point that an angle acts on, first found first used
_LEVERS = ("outer_um", "radius_um", "extent_um", "reach_um", "length_um", "opening_um")


def chains(
    target: Target,
    *,
    costs: Mapping[str, float] | None = None,
    controls: bool = False,
) -> tuple[Chain, ...]:
    """Return the chains to try on `target`, in a fixed order.

    1. Each routine that needs nothing and gives the place, alone.
    2. Routines for the angle alone, behind the cheapest of those that lack it. Of a
       target with an angle, chains are tried with and without it, because the trials
       decide whether it is needed.
    3. Each routine that needs a start, from coarse to fine: at the nominal place if
       that is sure to be within its capture range, else behind the cheapest chain that
       gives what it needs, and behind the finest one.
    4. Until there are `MOST_CHAINS`: a searching routine behind another, the cheapest
       first, or a cheap one behind one that searches angles too.

    Parameters
    ----------
    target : Target
        What is to be found.
    costs : mapping of str to float, optional
        Work of one `measure` by routine, as `Routine.cost` predicts it for the look. A
        routine missing here is left out: it could not be prepared. Without `costs` a
        routine counts as dearer the more it gives, and the fewer kinds it looks for:
        the special ones are the finer ones.
    controls : bool
        Whether routines known to be bad are tried too, one chain each, at the end.
    """
    names = routines(target, controls=True)
    if costs is None:
        costs = {name: _assumed_cost(load(name)) for name in names}
    price = {name: costs[name] for name in names if name in costs}
    plan = _Plan(target=target, price=price)
    found = plan.chains([n for n in plan.names if not load(n).CONTROL])[:MOST_CHAINS]
    if not controls:
        return found
    bad = [name for name in plan.names if load(name).CONTROL]
    return found + tuple(c for name in bad for c in plan.leading_to(name, found)[:1])


def routines(target: Target, *, controls: bool = False) -> tuple[str, ...]:
    """Return the routines that chains for `target` may use, by name.

    They look for its kind and give its place, or its angle if it has one.
    """
    useful = {"xy", "theta"} if has_angle(target) else {"xy"}
    return tuple(
        name
        for name in sorted(REGISTRY)
        if target.kind in load(name).KINDS
        and useful & set(load(name).GIVES)
        and (controls or not load(name).CONTROL)
    )


def has_angle(target: Target) -> bool:
    """Return whether the target's angle can be told within its declared range.

    Circles have none. A pattern that repeats has one if a notch breaks the symmetry, or
    if half a period is wider than the range, so that no two angles look alike.
    """
    if target.kind == "circle" or target.symmetry == 0:
        return False
    if "notch_rad" in target.parameters:
        return True
    order = max(target.symmetry, int(target.parameters.get("count", 1.0)))
    return order == 1 or target.theta_range_rad < math.pi / order


@dataclass(frozen=True, slots=True)
class _Plan:
    """What chains for one target are made of."""

    target: Target
    price: Mapping[str, float]

    @property
    def names(self) -> list[str]:
        """Return the routines, the cheapest first, then by name."""
        return sorted(self.price, key=lambda name: (self.price[name], name))

    def chains(self, names: Sequence[str]) -> tuple[Chain, ...]:
        """Return the chains made of `names`, in the order that `chains` states."""
        seeds = [n for n in names if not load(n).NEEDS and "xy" in load(n).GIVES]
        found: list[Chain] = [(name,) for name in seeds]
        pairs = self._pairs(seeds)
        rest = [name for name in names if name not in seeds]
        rest.sort(key=lambda name: (-load(name).CAPTURE_PX, name))  # coarse to fine
        for name in (n for n in rest if "xy" not in load(n).GIVES):
            found += self.leading_to(name, found + pairs)
        for name in (n for n in rest if "xy" in load(n).GIVES):
            found += self.leading_to(name, found)
        return tuple(dict.fromkeys(found + pairs))

    def leading_to(self, name: str, before: Sequence[Chain]) -> list[Chain]:
        """Return the chains that end in `name`, each behind one of `before`."""
        routine = load(name)
        missing = self._missing(routine)
        if not missing and "xy" in routine.GIVES:
            return [(name,)]
        missing |= set() if "xy" in routine.GIVES else {"xy"}
        able = [c for c in before if missing <= self._given(c) and name not in c]
        able.sort(key=self._dearness)
        if "xy" not in routine.GIVES:  # the place stays that of the chain before it
            lacking = [c for c in able if not set(routine.GIVES) <= self._given(c)]
            return [(*chain, name) for chain in lacking[:_ANGLES]]
        # behind the finest one as well: only that may fit into a narrow capture range
        fine = sorted(able, key=lambda chain: (self._capture_px(chain),))[:1]
        order = dict.fromkeys(able[:1] + fine + able[1:])
        return [(*chain, name) for chain in list(order)[:_LED]]

    def _pairs(self, seeds: Sequence[str]) -> list[Chain]:
        """Return searching routines behind one another; `seeds` are cheapest first.

        The cheapest one starts any other. A dearer one that searches angles too starts
        a cheaper one that gives as much, or any but the cheapest, which has no use for
        a start.
        """
        starts: list[Chain] = [(seeds[0], name) for name in seeds[1:]]
        for k, name in enumerate(seeds):
            gives = set(load(name).GIVES)
            wide = [n for n in seeds[k + 1 :] if "theta" in load(n).GIVES]
            if wide and (k > 0 or gives >= set(load(wide[0]).GIVES)):
                starts.append((wide[0], name))
        return starts

    def _missing(self, routine: Routine) -> set[Known]:
        """Return what the routine needs and the nominal pose does not give."""
        reach = {
            "xy": self.target.search_px,
            "theta": self.target.theta_range_rad * _lever_px(self.target),
        }
        return {
            known
            for known in routine.NEEDS
            if reach.get(known, math.inf) > routine.CAPTURE_PX
        }

    def _given(self, chain: Chain) -> set[Known]:
        """Return what the chain's routines give together."""
        return {known for name in chain for known in load(name).GIVES}

    def _dearness(self, chain: Chain) -> tuple[float, int, Chain]:
        """Return what orders chains by price, then length, then name."""
        return (sum(self.price[name] for name in chain), len(chain), chain)

    def _capture_px(self, chain: Chain) -> float:
        """Return the capture range of the last routine that gives the place."""
        placing = [name for name in chain if "xy" in load(name).GIVES]
        return load(placing[-1]).CAPTURE_PX


def _assumed_cost(routine: Routine) -> float:
    """Return a stand-in for the cost of a routine that is not prepared yet."""
    return len(routine.GIVES) + 1 / len(routine.KINDS)


def _lever_px(target: Target) -> float:
    """Return how far from the reference point an angle acts, 0 if it has none."""
    if not has_angle(target):
        return 0.0
    lengths = (target.parameters.get(name) for name in _LEVERS)
    return next((x for x in lengths if x is not None), 0.0) * target.px_per_um
