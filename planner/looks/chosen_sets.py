"""The set of features that a look measures together, and what it is good for."""

from __future__ import annotations

import math
from dataclasses import dataclass

from microplan.featuresel.sets.feature_set import FeatureSet
from microplan.featuresel.sets.pose_covariance import FeatureMeasurement
from microplan.featuresel.trials.score import ChainScore
from microplan.planner.looks.evaluated_feature import TestedFeature


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenSet:
    """The features that a look measures, the look's own target first if among them."""

    raced: tuple[TestedFeature, ...]
    sights: tuple[FeatureMeasurement, ...]
    score: ChainScore  # of fresh trials of all of them
    found: FeatureSet
    least: int  # that must answer
    shared_um: float  # one sigma of the target's place on the part, as made

    @property
    def sigma_um(self) -> float:
        """Return the spread of the target's place; the worse of trials and model."""
        seen = max(self.score.sigma_um or 0.0, self.found.known.sigma_um)
        return math.hypot(seen, self.shared_um)

    @property
    def need_um(self) -> float:
        """Return 2 sigma + |bias|, what a tolerance must hold."""
        return 2 * self.sigma_um + math.hypot(*(self.score.bias_um or (0.0, 0.0)))
