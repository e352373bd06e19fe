"""How far focus and zoom may drift before a chain misses its tolerance."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.bias import BiasCurve
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.tolerance_search import (
    BytesArray,
    Direction,
    ToleranceSearch,
)
from microplan.featuresel.trials.trials import Map, PreparedRoutines

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
    curve: BiasCurve | None = None,
) -> UsableRange:
    """Return the drifts of focus and zoom that `chain` stands.

    Each direction is searched outward by `microplan.featuresel.trials.tolerance_search`
    until one of `draws` noisy images is not measured within the tolerance; the last
    step before that is the answer. `map` gets one direction at a time, as in
    `microplan.featuresel.trials.trials.run`; `curve` is taken off the places that the
    chain finds.

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
        curve=curve,
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
