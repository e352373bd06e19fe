"""Evaluations of a look's features, with the prepared arrays of their routines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import numpy.typing as npt

from microplan.featuresel.features.feature import Feature, contour_px
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact, Failure
from microplan.featuresel.routines.registry import load
from microplan.featuresel.selection.evaluate import RoutineComparison
from microplan.featuresel.sets.criteria import (
    Candidate,
    Criteria,
    criteria,
    set_criteria,
)
from microplan.featuresel.sets.feature_set import FeatureSet
from microplan.featuresel.sets.pose_covariance import FeatureMeasurement
from microplan.featuresel.trials.repeatability import Trueness
from microplan.featuresel.trials.score import ChainScore
from microplan.optics.render.fidelity import Fidelity
from microplan.planner.views.targets import TargetShape
from microplan.schemas import plan as p


@dataclass(frozen=True, slots=True, kw_only=True)
class TestedFeature:
    """A feature whose routines were compared as one of several in a set."""

    feature: Feature
    shape: TargetShape
    tried: Evaluation

    @property
    def chosen(self) -> ChainScore:
        """Return the score of the chain that is best in a set.

        Raises
        ------
        ValueError
            If none passed.
        """
        if self.tried.comparison.selection.chosen is None:
            raise ValueError(f"no chain of {self.shape.name} passed")
        return self.tried.comparison.selection.chosen

    @property
    def passes(self) -> bool:
        """Return whether a chain is good enough for one of several features."""
        return self.tried.comparison.selection.chosen is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureRanking:
    """The ranking of the features of one look by Feddema's criteria."""

    case: LookCase  # of the look's own target
    radius_um: float  # scales the rotation

    @property
    def _angle(self) -> bool:
        return self.case.tolerance_theta_rad is not None

    def row(
        self, tested: TestedFeature, sight: FeatureMeasurement | None, reason: str
    ) -> p.FeatureRow:
        """Return one feature by Feddema's criteria, as far as it passed."""
        shape = tested.shape
        if sight is None:
            visible = tested.tried.comparison.visible
            return p.FeatureRow(
                name=shape.name, kind=shape.kind, reason=reason, completeness=visible
            )
        found = criteria(
            _candidate(tested, sight),
            radius_um=self.radius_um,
            theta_range_rad=self.case.target.theta_range_rad,
            angle=self._angle,
        )
        return _row(found, shape.name, shape.kind, reason)

    def set_row(
        self,
        tested: Sequence[TestedFeature],
        sights: Sequence[FeatureMeasurement],
        sigma_um: float,
    ) -> p.FeatureRow:
        """Return the set that is used by Feddema's criteria."""
        found = set_criteria(
            [_candidate(r, s) for r, s in zip(tested, sights, strict=True)],
            sigma_um,
            radius_um=self.radius_um,
            theta_range_rad=self.case.target.theta_range_rad,
            angle=self._angle,
        )
        return _row(found, " + ".join(r.shape.name for r in tested), "set", "used")


def unseen(case: LookCase) -> str:
    """Return why a feature cannot be searched for in the region, "" if it can."""
    target, window = case.target, case.window
    if not target.contour:
        return "its edges are not drawn"
    column, row = contour_px(target)
    room = [column.min(), row.min()]
    room += [window.columns - 1 - column.max(), window.rows - 1 - row.max()]
    if min(room) >= target.search_px:
        return ""
    return "not tried: it may lie outside the region of the look"


def _candidate(tested: TestedFeature, sight: FeatureMeasurement) -> Candidate:
    """Return a tested feature as a candidate of the criteria."""
    return Candidate(
        feature=tested.feature,
        score=tested.chosen,
        measurement=sight,
        seen=tested.tried.comparison.visible,
    )


def _row(found: Criteria, name: str, kind: str, reason: str) -> p.FeatureRow:
    """Return criteria as the plan has them; what is infinite is not known."""
    values = asdict(found) | {
        "name": name,
        "resolution_um": _finite(found.resolution_um),
        "conditioning": _finite(found.conditioning),
    }
    return p.FeatureRow(kind=kind, reason=reason, **values)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenSet:
    """The features that a look measures, the look's own target first if among them."""

    tested: tuple[TestedFeature, ...]
    sights: tuple[FeatureMeasurement, ...]
    score: ChainScore  # of fresh trials of all of them
    found: FeatureSet
    least: int  # that must answer
    shared_um: float  # sigma of the target's position on the part, as fabricated
    repeated: ChainScore | None = None  # of random trials, once the set is chosen
    trueness: Trueness | None = None  # of its answers in these

    @property
    def sigma_um(self) -> float:
        """Return sigma of the target's position, um; the worse of trials and model."""
        tried = self.repeated or self.score
        seen = max(tried.sigma_um or 0.0, self.found.known.sigma_um)
        return math.hypot(seen, self.shared_um)

    @property
    def need_um(self) -> float:
        """Return 2 sigma + |bias|, what a tolerance must hold."""
        return 2 * self.sigma_um + math.hypot(*(self.score.bias_um or (0.0, 0.0)))


Arrays = Mapping[str, Mapping[str, npt.NDArray[np.float32]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """A look's case, how it is rendered, and its comparison of routines."""

    case: LookCase
    fidelity: Fidelity
    comparison: RoutineComparison


def used(tried: Evaluation) -> tuple[str, ...]:
    """Return the routines of chain and fallback, each once."""
    selection = tried.comparison.selection
    both = (selection.chosen, selection.fallback)
    return tuple(dict.fromkeys(r for score in both if score for r in score.chain))


def used_alone(tried: Evaluation) -> Evaluation:
    """Return an evaluation with what it knows of chain and fallback alone.

    The other routines' artifacts take most of a look's memory.
    """
    selection, names = tried.comparison.selection, used(tried)
    both = (selection.chosen, selection.fallback)
    kept = tried.comparison.only([score.chain for score in both if score])
    artifacts = {name: kept.prepared.artifacts[name] for name in names}
    prepared = replace(kept.prepared, artifacts=artifacts)
    return replace(tried, comparison=replace(kept, prepared=prepared))


def _artifact(tried: Evaluation, name: str) -> Artifact:
    """Return what a routine prepared; one that failed to is never selected."""
    found = tried.comparison.prepared.artifacts[name]
    if isinstance(found, Failure):
        raise ValueError(f"{name} was selected but not prepared: {found.message}")
    return found


def arrays_of(look: str, tried: Evaluation) -> Arrays:
    """Return the arrays of the routines used, by their path in the plan folder."""
    made = {name: _artifact(tried, name).arrays for name in used(tried)}
    return {_array_path(look, name): arrays for name, arrays in made.items() if arrays}


def _array_path(look: str, name: str) -> str:
    return f"artifacts/{look}.{name}.npz"


def use_of(look: str, tried: Evaluation, name: str) -> p.RoutineUse:
    """Return one routine of a chain as the plan has it."""
    artifact = _artifact(tried, name)
    return p.RoutineUse(
        id=name,
        version=load(name).version,
        parameters=artifact.parameters,
        arrays=_array_path(look, name) if artifact.arrays else None,
    )
