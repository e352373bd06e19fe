"""What errors of images cost a feature's chain and its fallback."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from microplan.featuresel.trials.chains import Chain
from microplan.planner.looks.model_errors.model_cost import (
    AcceptedRange,
    EffectDifference,
)
from microplan.schemas import plan as p


@dataclass(frozen=True, slots=True, kw_only=True)
class ChargedChains:
    """What effects cost a feature's chain and its fallback, in um."""

    chain: p.ModelCost | None = None  # None: every effect is within its limit
    fallback: p.ModelCost | None = None
    rows: Mapping[str, EffectDifference] = field(default_factory=dict)  # by effect
    fault: str = ""  # why the look cannot be charged; "": it can
    # why each chain is not used that the look would have used else, in that order
    struck: Mapping[Chain, str] = field(default_factory=dict)
    # of right answers on better images
    accepted: AcceptedRange = field(default_factory=AcceptedRange)
    fallback_accepted: AcceptedRange = field(default_factory=AcceptedRange)
    missed: str = ""  # by what the chain misses its tolerance; "": it does not
