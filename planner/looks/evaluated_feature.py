"""A feature after its race, and what the plan's table of features says of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.featuresel.features.completeness import contour_px
from microplan.featuresel.features.feature import Feature
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.sets.criteria import (
    Candidate,
    Criteria,
    criteria,
    set_criteria,
)
from microplan.featuresel.sets.pose_covariance import FeatureMeasurement
from microplan.featuresel.trials.score import ChainScore
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.views.targets import TargetShape
from microplan.schemas import plan as p


@dataclass(frozen=True, slots=True, kw_only=True)
class TestedFeature:
    """A feature that was raced; its selection is that of one of several features."""

    feature: Feature
    shape: TargetShape
    tried: Evaluation
    visible: float | None  # share of its edges

    @property
    def chosen(self) -> ChainScore:
        """Return the score of the chain that is best in a set.

        Raises
        ------
        ValueError
            If none passed.
        """
        if self.tried.selection.chosen is None:
            raise ValueError(f"no chain of {self.shape.name} passed")
        return self.tried.selection.chosen

    @property
    def passes(self) -> bool:
        """Return whether a chain is good enough for one of several features."""
        return self.tried.selection.chosen is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureRanking:
    """How the features of one look are compared."""

    case: LookCase  # of the look's own target
    radius_um: float  # scales the rotation

    @property
    def _angle(self) -> bool:
        return self.case.tolerance_theta_rad is not None

    def row(
        self, raced: TestedFeature, sight: FeatureMeasurement | None, reason: str
    ) -> p.FeatureRow:
        """Return one feature by Feddema's criteria, as far as it passed."""
        if sight is None:
            return p.FeatureRow(
                name=raced.shape.name,
                kind=raced.shape.kind,
                reason=reason,
                completeness=raced.visible,
            )
        found = criteria(
            _candidate(raced, sight),
            radius_um=self.radius_um,
            theta_range_rad=self.case.target.theta_range_rad,
            angle=self._angle,
        )
        return _row(found, raced.shape.name, raced.shape.kind, reason)

    def set_row(
        self,
        raced: Sequence[TestedFeature],
        sights: Sequence[FeatureMeasurement],
        sigma_um: float,
    ) -> p.FeatureRow:
        """Return a set that is used by Feddema's criteria."""
        found = set_criteria(
            [_candidate(r, s) for r, s in zip(raced, sights, strict=True)],
            sigma_um,
            radius_um=self.radius_um,
            theta_range_rad=self.case.target.theta_range_rad,
            angle=self._angle,
        )
        return _row(found, " + ".join(r.shape.name for r in raced), "set", "used")


def unseen(case: LookCase) -> str:
    """Return why a feature cannot be looked for in the region, "" if it can."""
    target, window = case.target, case.window
    if not target.contour:
        return "its edges are not drawn"
    column, row = contour_px(target)
    room = [column.min(), row.min()]
    room += [window.columns - 1 - column.max(), window.rows - 1 - row.max()]
    if min(room) >= target.search_px:
        return ""
    return "not tried: it may lie outside the region of the look"


def _candidate(raced: TestedFeature, sight: FeatureMeasurement) -> Candidate:
    """Return a raced feature as criteria want it."""
    return Candidate(
        feature=raced.feature, score=raced.chosen, sight=sight, seen=raced.visible
    )


def _row(found: Criteria, name: str, kind: str, reason: str) -> p.FeatureRow:
    """Return criteria as the plan has them; what is infinite is not known."""
    return p.FeatureRow(
        name=name,
        kind=kind,
        reason=reason,
        chain=found.chain,
        robustness=found.robustness,
        uniqueness=found.uniqueness,
        completeness=found.completeness,
        cost=found.cost,
        resolution_um=_finite(found.resolution_um),
        rank=found.rank,
        controllability=found.controllability,
        conditioning=_finite(found.conditioning),
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
