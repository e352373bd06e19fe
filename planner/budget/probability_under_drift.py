"""Whether an insertion keeps its chance while one setting of one look is off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.tolerance_search import Setting
from microplan.planner.budget.budget import FOCUS_TERM
from microplan.planner.budget.insertion import Insertion


@dataclass(frozen=True, slots=True, kw_only=True)
class Borne:
    """Asks of what a look measured at a drift whether the insertion bears it.

    What the draws are off by on average is an offset that nobody corrects, in the worst
    direction; what they scatter by counts as the look's error where it is larger than
    what the trials found. It is asked of draws that are all `is_placed`.
    """

    job: Insertion
    goal: float  # chance that the insertion must keep
    term: str  # of the look's error in the budget
    setting: Setting
    bias_um: tuple[float, float]  # taken off what is measured, in the target's frame
    lateral_um: float = 0.0  # sigma per um of focus that the lens shifts by

    def __call__(self, drift: float, found: Sequence[Outcome], /) -> bool:
        """Return whether the chance is kept at `drift`."""
        places = np.array([outcome.target_um for outcome in found], dtype=np.float64)
        errors = places - np.array(self.bias_um)
        offset_um = math.hypot(*errors.mean(axis=0))
        job = self._at(drift, _scatter_um(errors))
        return 1 - job.missed_with(offset_um) >= self.goal

    def _at(self, drift: float, scatter_um: float) -> Insertion:
        """Return the insertion with the look's error, and the lens's, at a drift."""
        job, sizes = self.job, self.job.sizes_um
        job = job.resized(self.term, max(scatter_um, sizes.get(self.term, 0.0)))
        if self.setting != "focus" or FOCUS_TERM not in sizes:
            return job
        grown_um = sizes[FOCUS_TERM] + self.lateral_um * abs(drift)
        return job.resized(FOCUS_TERM, grown_um)


def is_placed(outcome: Outcome) -> bool:
    """Return whether a draw gave a place; a look that gives none is repeated for ever.

    What such a drift does to the insertion need not be asked.
    """
    return outcome.target_um is not None


def _scatter_um(errors_um: np.ndarray) -> float:
    """Return the scatter per axis of errors (N, 2) about their mean; 0 of one."""
    free = 2 * (len(errors_um) - 1)
    if free <= 0:
        return 0.0
    off = errors_um - errors_um.mean(axis=0)
    return math.sqrt(float((off**2).sum()) / free)
