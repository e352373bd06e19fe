"""Usable ranges: how far focus or zoom may drift before a tolerance is missed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import numpy as np
import numpy.typing as npt

from microplan.featuresel.features.factorial_design import words
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.focus_series import (
    Pictures,
    one_by_one,
    posed,
    through_focus,
)
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.trials import Map, PreparedRoutines, measure_picture

BytesArray = npt.NDArray[np.uint8]
Setting = Literal["focus", "zoom", "light", "gradient", "pose"]

# Steps outward from nominal; the zoom's and the light's are of their ratio. A drift
# beyond the last is no drift any more.
FOCUS_UM = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 13.0, 16.0, 20.0, 25.0, 32.0, 40.0)
ZOOM = (0.002, 0.004, 0.006, 0.008, 0.01, 0.015, 0.02, 0.03, 0.05)
DARKER = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.97, 0.98)
BRIGHTER = (0.1, 0.2, 0.3, 0.4, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0)
GRADIENT = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
POSE_UM = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 13.0, 16.0, 20.0, 25.0, 32.0, 40.0)
FEW = 3  # draws by which the last drift is guessed before all are made
STRIDE = 4  # steps taken at once; shorter gaps of failures may be passed over
GOLDEN_RAD = math.pi * (3 - math.sqrt(5))  # turns that never repeat


# whether one draw may be part of a tolerated drift: all must be; picklable
Passes = Callable[[Outcome], bool]
# whether a drift is tolerated by what its draws measured together; picklable
Holds = Callable[[float, Sequence[Outcome]], bool]


@dataclass(frozen=True, slots=True)
class Direction:
    """One way for a setting to drift: which, and to which side."""

    setting: Setting
    sign: Literal[-1, 1]

    @property
    def drifts(self) -> tuple[float, ...]:
        """Return the drifts tried, outward; um, or a change of the ratio to nominal."""
        steps: Mapping[str, tuple[float, ...]] = {
            "focus": FOCUS_UM,
            "zoom": ZOOM,
            "light": DARKER if self.sign < 0 else BRIGHTER,
            "gradient": GRADIENT,
            "pose": POSE_UM,
        }
        return tuple(self.sign * step for step in steps[self.setting])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reached:
    """The last drift that is tolerated, and what the camera shows there."""

    drift: float  # 0 if none is tolerated
    picture: BytesArray | None  # 8 bit, of the first draw; None: none is tolerated


@dataclass(frozen=True, slots=True, kw_only=True)
class ToleranceSearch:
    """One chain of a look, asked how far settings may drift."""

    case: LookCase
    prepared: PreparedRoutines  # the chain alone
    root_seed: int
    draws: int  # noisy images at each drift

    def __post_init__(self) -> None:
        if self.draws < 1:
            raise ValueError(f"draws must be at least 1, got {self.draws}")
        if len(self.prepared.chains) != 1:
            raise ValueError(f"one chain is asked, got {self.prepared.chains}")

    def reach(
        self, direction: Direction, passes: Passes, holds: Holds | None = None
    ) -> float:
        """Return the last drift in one direction that is tolerated, 0 if none is.

        As `reached`, without the picture.
        """
        return self.reached(direction, passes, holds).drift

    def reached(
        self, direction: Direction, passes: Passes, holds: Holds | None = None
    ) -> Reached:
        """Return the last drift in one direction that is tolerated, with a picture.

        The target lies at as many random places of its pose spread as there are
        draws, the same at all drifts. A drift is tolerated where every draw passes and
        all of them together hold; after one that does not pass no other is made. Which
        drifts are tried says `last_held`. Where each draw is judged by itself, the
        first few show how far to go, and all are made there; where one fails, nearer.
        """
        shown: dict[int, BytesArray] = {}
        drifts = direction.drifts
        trials = {drift: self._trials(direction, drift) for drift in drifts}
        pictures = self._pictures(direction, trials[drifts[-1]][0])
        known: dict[int, list[Outcome]] = {step: [] for step in range(len(drifts))}

        def held(step: int, draws: int = self.draws) -> bool:
            found = known[step]
            left = trials[drifts[step]][len(found) : draws]
            for trial, picture in zip(left, pictures(left), strict=True):
                shown.setdefault(step, _eight_bit(picture))
                found.append(self._outcome(trial, picture))
                if not passes(found[-1]):
                    return False
            return holds is None or holds(drifts[step], found)

        if holds is None and self.draws > FEW:
            last = last_held(len(drifts), partial(held, draws=FEW))
            if last >= 0 and not held(last):
                last = last_held(last, held)
        else:
            last = last_held(len(drifts), held)
        return Reached(
            drift=drifts[last] if last >= 0 else 0.0, picture=shown.get(last)
        )

    def _pictures(self, direction: Direction, farthest: Trial) -> Pictures:
        """Return what makes the images of one direction."""
        if direction.setting == "focus" and self.case.shares_spectra:
            return through_focus(self.case, farthest)
        shared = None
        if direction.setting != "pose":
            shared = posed(self.case, farthest)
        return shared or partial(one_by_one, self.case)

    def _outcome(self, trial: Trial, picture: np.ndarray) -> Outcome:
        """Return what the chain says of one picture."""
        (found,) = measure_picture(self.case, self.prepared, trial, picture)
        return found

    def _trials(self, direction: Direction, drift: float) -> list[Trial]:
        """Return the trials of one drift."""
        name = direction.setting
        return [_drifted(self._trial(name, drift, k), name, drift)
                for k in range(self.draws)]  # fmt: skip

    def _trial(self, name: str, drift: float, draw: int) -> Trial:
        """Return a nominal trial; the draw alone decides where the target is."""
        case, root = self.case, self.root_seed
        seed = (root, *words(f"{case.key}/usable {name} {drift:g} {draw}"))
        place = (root, *words(f"{case.key}/usable {draw}"))
        rng = np.random.default_rng(np.random.SeedSequence(place))
        dx, dy, turn = np.clip(rng.standard_normal(3), -2, 2)
        theta = float(turn) * case.spread.pose_sigma_theta_rad
        if case.theta_any:
            theta = float(rng.uniform(-math.pi, math.pi))
        return Trial(
            index=draw,
            dx_um=float(dx) * case.spread.pose_sigma_xy_um,
            dy_um=float(dy) * case.spread.pose_sigma_xy_um,
            dtheta_rad=theta,
            model=case.model,
            seed=seed,
        )


def last_held(count: int, holds: Callable[[int], bool]) -> int:
    """Return the last of `count` steps before the first that does not hold.

    Parameters
    ----------
    count : int
        How many steps there are, numbered from 0 outward.
    holds : callable
        Whether a step holds; asked of six of thirteen at most.

    Returns
    -------
    int
        -1 if no step holds. Every `STRIDE`-th and the last are tried outward until one
        fails, then the steps since the one before are halved. The step returned holds
        and the next one does not; `STRIDE` or more failing in a row are never passed
        over, fewer may be where steps beyond hold again.
    """
    good, bad = -1, count
    if count < 1:
        return good
    for step in (*range(STRIDE - 1, count - 1, STRIDE), count - 1):
        if not holds(step):
            bad = step
            break
        good = step
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if holds(middle) else (good, middle)
    return good


def _eight_bit(picture: np.ndarray) -> BytesArray:
    """Return a picture in 0..1 as 8 bit."""
    found: BytesArray = np.clip(np.rint(picture * 255), 0, 255).astype(np.uint8)
    return found


def _drifted(trial: Trial, setting: Setting, drift: float) -> Trial:
    """Return a trial with one setting off; draws take a direction of their own."""
    if setting == "focus":
        return replace(trial, dz_um=drift)
    if setting == "zoom":
        return replace(trial, magnification=1 + drift)
    if setting == "light":
        return replace(trial, gain=1 + drift)
    angle = trial.index * GOLDEN_RAD
    x, y = drift * math.cos(angle), drift * math.sin(angle)
    if setting == "gradient":
        return replace(trial, gradient_x=x, gradient_y=y)
    return replace(trial, dx_um=trial.dx_um + x, dy_um=trial.dy_um + y)


# Focus goes farther and takes longer: those two first.
NEARER, FARTHER = Direction("focus", -1), Direction("focus", 1)
SMALLER, LARGER = Direction("zoom", -1), Direction("zoom", 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class UsableRange:
    """Drifts at which every draw met the tolerance; (0, 0) or (1, 1) if none did."""

    focus_um: tuple[float, float]  # error of the focus height
    magnification: tuple[float, float]  # ratio to nominal
    # 8 bit, at the least and most focus and zoom; None where a range has no end
    pictures: tuple[BytesArray | None, ...] = field(default=(), compare=False)


def usable_range(
    case: LookCase,
    prepared: PreparedRoutines,
    chain: Chain,
    *,
    root_seed: int,
    draws: int = 3,
    map: Map = map,  # noqa: A002 - it is the builtin, or a pool's
) -> UsableRange:
    """Return the drifts of focus and zoom that `chain` tolerates.

    Each direction is searched outward by `microplan.featuresel.trials.tolerance_search`
    until one of `draws` noisy images is not measured within the tolerance; the last
    step before that is the answer. `map` gets one direction at a time, as in
    `microplan.featuresel.trials.trials.run`.

    Raises
    ------
    ValueError
        If `draws` is below 1.
    """
    search = ToleranceSearch(
        case=case,
        prepared=alone(prepared, chain),
        root_seed=root_seed,
        draws=draws,
    )
    reach = partial(search.reached, passes=partial(_meets, case))
    ends = list(map(reach, [NEARER, FARTHER, SMALLER, LARGER]))
    nearer, farther, smaller, larger = (end.drift for end in ends)
    return UsableRange(
        focus_um=(nearer, farther),
        magnification=(1 + smaller, 1 + larger),
        pictures=tuple(end.picture for end in ends),
    )


def alone(prepared: PreparedRoutines, chain: Chain) -> PreparedRoutines:
    """Return what one chain needs of what was prepared."""
    artifacts = {name: prepared.artifacts[name] for name in chain}
    return PreparedRoutines(chains=(chain,), artifacts=artifacts)


def _meets(case: LookCase, outcome: Outcome) -> bool:
    """Return whether a draw was measured within every tolerance."""
    limit = case.tolerance_theta_rad
    return outcome.distance_um <= case.tolerance_um and (
        limit is None
        or (outcome.theta_rad is not None and abs(outcome.theta_rad) <= limit)
    )
