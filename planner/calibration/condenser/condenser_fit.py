"""Coherence at each setting of a condenser, and the edges' own offset: one fit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from microplan.arrays import FloatArray
from microplan.planner.calibration.condenser.coherent_profiles import (
    WAVES,
    CoherentProfiles,
)
from microplan.planner.calibration.estimates import (
    FEWEST_BLOCKS,
    BlockEstimate,
    Refused,
    VectorEstimate,
    jackknife_covariance,
)

FEWEST_SETTINGS = 2
APART = 1.25  # times the smallest setting: closer ones show one light
TAKE = (
    "the part in focus at two settings of the condenser or more, some .3 and .8 of "
    "the objective's aperture, each at six places or more"
)
_METHOD = "edges at settings of the condenser against coherent images; places left out"
_BETTER = 0.9  # of the squared error of pictures left out that a term must reach
_CLEARLY = 0.5  # the same of few places, where no deviation tells chance from it
_SURE = 3.0  # standard deviations by which a setting is off the common factor
_VAGUE = 0.2  # of a coherence: it is not told
_AT_END = 1e-3  # of an end of the table
_MOST_RMS = 0.015  # of an edge's step, that images are off by: something else is wrong
_MOST_WAVES = 0.15  # of defocus at the rim, where changes are no longer its square
_LEAST_CONTRAST = 0.1  # of amplitudes: fainter edges hardly change with coherence
# rms of an edge's step: by as much images of the compiler change with more points of
# the source, and differ from those of twins
_TRUE = 4e-4
# rms of the edge's step by which images of a right lens are off in twins; what more is
# off may look like other numbers as well
USUAL = 1e-3
_FIXED = 3  # numbers before those of coherence: offset px, ratio, defocus
_STEP = 1e-4  # by which numbers are changed for slopes


@dataclass(frozen=True, slots=True, kw_only=True)
class CondenserLook:
    """Mean profile across a part's edges at a place and a setting."""

    place: str
    setting: float  # relative aperture as read: condenser over objective
    profile: FloatArray  # (L,) light


@dataclass(frozen=True, slots=True, kw_only=True)
class CondenserFit:
    """What edges at several settings tell.

    Readings are right up to one factor, unless each setting is its own.
    """

    settings: tuple[float, ...]  # relative apertures as read, rising
    numbers: VectorEstimate  # offset px, ratio of amplitudes, then one a setting
    each_its_own: bool
    defocus: float  # as `CoherentProfiles` has it; 0: not told from none
    better: dict[str, float]  # squared error left out with a term, over that without
    rms: float  # of profiles about the images', of the edge's step
    misfit: float  # the same of all places together: less noise

    @property
    def waves(self) -> float:
        """Return the defocus at the pupil's rim, waves."""
        return WAVES * math.sqrt(abs(self.defocus))

    @property
    def offset_px(self) -> BlockEstimate:
        """Return how far the part's own edges lie outwards from those drawn."""
        return self.numbers.one(0)

    @property
    def ratio(self) -> BlockEstimate:
        """Return the amplitude around the part over its own."""
        return self.numbers.one(1)

    def coherence(self, setting: float) -> BlockEstimate:
        """Return the coherence at a setting."""
        return self.numbers.one(2 + self.settings.index(setting))


def unfit_settings(readings: Sequence[float]) -> Refused | None:
    """Return why settings, in any unit, tell no coherence; None if they may."""
    what, found = "coherence", sorted(set(readings))
    if len(found) < FEWEST_SETTINGS:
        why = f"{len(found)} setting of the condenser, {FEWEST_SETTINGS} are needed"
        return Refused(what=what, why=why, take=TAKE)
    if found[-1] < APART * found[0]:
        why = (
            f"settings are too close, the largest is {found[-1] / found[0]:.3g} times "
        )
        why += f"the least, {APART:g} times is needed"
        return Refused(what=what, why=why, take=TAKE)
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class AtEnd(Refused):
    """A coherence at an end of the table: another table may hold it."""


def fit_condenser(
    looks: Sequence[CondenserLook], table: CoherentProfiles
) -> CondenserFit | Refused:
    """Return coherence at each setting and the edges' offset.

    Parameters
    ----------
    looks : sequence of CondenserLook
        One of each place and setting, in one order.
    table : CoherentProfiles
        The compiler's images.
    """
    refused = unfit_settings([look.setting for look in looks])
    if refused is not None:
        return refused
    plan = _Terms(looks=tuple(looks), table=table)
    plan = replace(plan, names=plan.others)
    better: dict[str, float] = {}
    while True:
        error = plan.held_out()
        without = {name: plan.without(name).held_out() for name in plan.names}
        shares = {name: error / max(other, 1e-300) for name, other in without.items()}
        better |= shares
        doubtful = [name for name in plan.names if not _is_told(plan, name, shares)]
        if shares.get("own", 1.0) < _CLEARLY and len(plan.places) < FEWEST_BLOCKS:
            why = "settings seem to share no factor of their readings, at "
            why += f"{len(plan.places)} places: from {FEWEST_BLOCKS} on that is told"
            return Refused(what="coherence", why=why, take=TAKE)
        if not doubtful:
            return _told(_found(plan, better), table)
        plan = plan.without(max(doubtful, key=shares.__getitem__))


def _is_told(plan: _Terms, name: str, shares: Mapping[str, float]) -> bool:
    """Return whether a term is needed."""
    if shares[name] >= _BETTER:
        return False
    return name != "own" or _differ(plan.without("own"), plan)


def _differ(plan: _Terms, more: _Terms) -> bool:
    """Return whether a setting is surely off the factor that is common to all."""
    found = _found(more, {})
    together = plan.coherence(plan.solved(plan.looks))
    each = ((found.coherence(s), together[s]) for s in found.settings)
    return any(abs(o.value - t) > _SURE * (o.sigma or math.inf) for o, t in each)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Terms:
    """Pictures, and which numbers are free."""

    looks: tuple[CondenserLook, ...]
    table: CoherentProfiles
    names: tuple[str, ...] = ()  # of "focus" and "own" those that are free

    def without(self, name: str) -> _Terms:
        """Return the fit with a term less."""
        return replace(self, names=tuple(n for n in self.names if n != name))

    @property
    def others(self) -> tuple[str, ...]:
        """Return what else may be free; a single place does not foretell another's."""
        return ("focus", "own") if len(self.places) > 1 else ("focus",)

    @property
    def places(self) -> list[str]:
        return list(dict.fromkeys(look.place for look in self.looks))

    @property
    def settings(self) -> list[float]:
        return sorted({look.setting for look in self.looks})

    @property
    def blocks(self) -> list[list[CondenserLook]]:
        """Return pictures by places; of one place each picture."""
        if len(self.places) == 1:
            return [[look] for look in self.looks]
        return [[look for look in self.looks if look.place == p] for p in self.places]

    def coherence(self, numbers: FloatArray) -> dict[float, float]:
        """Return coherence by settings: times one factor, or each its own."""
        shares = numbers[_FIXED:] * np.ones(len(self.settings))
        return dict(zip(self.settings, (shares * self.settings).tolist(), strict=True))

    def off(self, numbers: FloatArray, looks: Sequence[CondenserLook]) -> FloatArray:
        """Return by how much profiles are off, (N L,), of the edge's step."""
        offset_px, ratio, defocus = numbers[:_FIXED].tolist()
        found = self.coherence(numbers)
        meant = {
            s: self.table(found[s], ratio, defocus, offset_px)
            for s in {look.setting for look in looks}
        }
        return np.concatenate([_off(each, meant[each.setting]) for each in looks])

    def solved(self, looks: Sequence[CondenserLook]) -> FloatArray:
        """Return the numbers that suit some pictures best."""
        count = len(self.settings) if "own" in self.names else 1
        full = np.append([0.0, _ratio(looks), 0.0], np.ones(count))
        free = [0, 1, *([2] if "focus" in self.names else [])]
        free += range(_FIXED, len(full))

        def misfits(some: FloatArray) -> FloatArray:
            numbers = full.copy()
            numbers[free] = some
            return self.off(numbers, looks)

        best = least_squares(misfits, full[free], x_scale=0.1, method="lm")
        full[free] = best.x
        return full

    def held_out(self) -> float:
        """Return the squared misfit of blocks left out by the numbers of the others."""
        total, blocks = 0.0, self.blocks
        for left in blocks:
            kept = [look for block in blocks if block is not left for look in block]
            total += float(np.sum(self.off(self.solved(kept), left) ** 2))
        return total

    def outputs(self, numbers: FloatArray) -> FloatArray:
        """Return offset, ratio and coherence at each setting, of numbers."""
        return np.append(numbers[:2], list(self.coherence(numbers).values()))

    def misfit(self, numbers: FloatArray) -> float:
        """Return by how much all places together are off, rms of an edge's step."""
        means = []
        for setting in self.settings:
            some = [look for look in self.looks if look.setting == setting]
            means.append(self.off(numbers, some).reshape(len(some), -1).mean(axis=0))
        return float(np.sqrt(np.mean(np.square(means))))

    def common(self, numbers: FloatArray) -> FloatArray:
        """Return the outputs' covariance by what images of two makers differ by."""
        here, slopes, moves = self.off(numbers, self.looks), [], []
        for k in range(len(numbers)):
            if k == 2 and "focus" not in self.names:
                continue
            other = numbers.copy()
            other[k] += _STEP
            slopes.append((self.off(other, self.looks) - here) / _STEP)
            moves.append((self.outputs(other) - self.outputs(numbers)) / _STEP)
        design, moved = np.stack(slopes, axis=1), np.stack(moves, axis=1)
        inner = np.linalg.pinv(design.T @ design)
        true = _TRUE * max(self.misfit(numbers) / USUAL, 1.0)
        covariance: FloatArray = true**2 * len(here) * moved @ inner @ moved.T
        return covariance


def _ratio(looks: Sequence[CondenserLook]) -> float:
    """Return about the amplitude around the part over its own."""
    inside, outside = (sum(float(look.profile[k]) for look in looks) for k in (0, -1))
    return math.sqrt(max(outside, 1e-6) / max(inside, 1e-6))


def _off(look: CondenserLook, meant: FloatArray) -> FloatArray:
    """Return a profile less an image's in its light, (L,), over its step."""
    light = float(look.profile @ meant) / float(meant @ meant)
    size = max(abs(light) * float(np.ptp(meant)), 1e-9)
    return np.asarray((look.profile - light * meant) / size)


def _found(plan: _Terms, better: dict[str, float]) -> CondenserFit:
    """Return the numbers that suit pictures best."""
    places, numbers = plan.places, plan.solved(plan.looks)
    covariance = None
    if len(places) >= FEWEST_BLOCKS:
        without = [
            plan.outputs(plan.solved([e for e in plan.looks if e.place != place]))
            for place in places
        ]
        covariance = jackknife_covariance(without)
    if covariance is not None:
        covariance = covariance + plan.common(numbers)
    return CondenserFit(
        settings=tuple(plan.settings),
        numbers=VectorEstimate(
            values=plan.outputs(numbers),
            covariance=covariance,
            method=_METHOD,
            blocks=len(places),
        ),
        each_its_own="own" in plan.names,
        defocus=float(numbers[2]),
        better=better,
        rms=float(np.sqrt(np.mean(plan.off(numbers, plan.looks) ** 2))),
        misfit=plan.misfit(numbers),
    )


def _told(fit: CondenserFit, table: CoherentProfiles) -> CondenserFit | Refused:
    """Return a fit, or why it tells no coherence."""
    why = _untold(fit)
    if why:
        return Refused(what="coherence", why=why, take=TAKE)
    low, high = table.least * (1 + _AT_END), table.most * (1 - _AT_END)
    for setting in fit.settings:
        found = fit.coherence(setting).value
        if not low < found < high:
            why = f"a setting that means {setting:.3g} suits best at {found:.3g}, "
            why += f"an end of the {table.least:.3g} to {table.most:.3g} tried"
            return AtEnd(what="coherence", why=why, take=TAKE)
    return fit


def _untold(fit: CondenserFit) -> str:
    """Return why a fit tells no coherence, "" if it does."""
    if fit.waves > _MOST_WAVES:
        how = "out of focus" if fit.defocus > 0 else "sharper than in focus"
        why = f"the edges are {how} by {fit.waves:.2g} waves at the pupil's rim"
        return why + ", or the lens has aberrations that are not stated"
    ratio = fit.ratio.value
    if abs(1 - ratio) < _LEAST_CONTRAST * max(1.0, ratio):
        return f"its edges are too faint: amplitudes are 1 to {ratio:.3g}"
    if fit.rms > _MOST_RMS:
        why = f"images are off by {fit.rms:.1%} of an edge's step; are aperture, "
        return why + "response and black level right, and edges in focus?"
    for setting in fit.settings:
        found = fit.coherence(setting)
        if (found.sigma or 0.0) > _VAGUE * found.value:
            return f"at {setting:.3g} it is {found.value:.2g} +- {found.sigma:.2g}"
    return ""
