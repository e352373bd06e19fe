"""What errors of images cost a feature's chain and its fallback."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from microplan.planner.looks.model_errors.model_cost import EffectDifference
from microplan.schemas import plan as p


@dataclass(frozen=True, slots=True, kw_only=True)
class ChargedChains:
    """What effects cost a feature's chain and its fallback, in um."""

    chain: p.ModelCost | None = None  # None: every effect is within its limit
    fallback: p.ModelCost | None = None
    rows: Mapping[str, EffectDifference] = field(default_factory=dict)  # by effect
    fault: str = ""  # why an effect cannot be charged; "": all are
    swapped: str = ""  # why the fallback is used instead of the chain; "": it is not
    dropped: str = ""  # why there is no fallback any more; "": there is, or was none
