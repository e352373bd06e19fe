"""Evidence of a look for its report: positions, trials, pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from microplan.featuresel.look.design import design, rebuild
from microplan.featuresel.look.perturb import image
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.trials import is_wrong
from microplan.planner.assembly.assembly import State, part_pose, robot_pose
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.measures import MeasuredFeature
from microplan.planner.store.memo import Memo
from microplan.planner.store.pictures import Picture, picture
from microplan.planner.task.task import Task
from microplan.planner.views.requests import Request
from microplan.schemas.files.evidence import (
    FOLDER,
    FeatureMark,
    LookEvidence,
    Shown,
    TrialRecord,
)
from microplan.schemas.pose import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class LookFigures:
    """Figures of a look for reports, with its pictures by their path in the folder."""

    evidence: LookEvidence
    pictures: Mapping[str, Picture]


_ENDS = ("focus", "focus", "magnification", "magnification")


def evidence_of(
    task: Task, request: Request, found: Sequence[MeasuredFeature], memo: Memo
) -> LookFigures:
    """Return the figures of a look at these features for its report.

    Nothing is rendered but the worst trial, once more: which it is was not known when
    it was made. The images at the ends of the range are those of the search for them.
    """
    first = found[0]
    pictures = dict(_pictures(task, request.id, first, memo))
    evidence = LookEvidence(
        look=request.id,
        places=_places(task, request.state),
        opening_um=request.state.opening_um if request.state.tool else None,
        features=tuple(_mark(each) for each in found),
        trials=_trials(first.tried, first.chosen, task.seed),
        shown=tuple(pictures),
    )
    return LookFigures(
        evidence=evidence,
        pictures={shown.image: each for shown, each in pictures.items()},
    )


def _places(task: Task, state: State) -> dict[str, Pose]:
    """Return where parts and the tool are while looking."""
    found = {name: part_pose(task, state, name) for name in sorted(state.parts)}
    if state.tool is not None:
        found[state.tool] = robot_pose(state.robot)
    return found


def _mark(found: MeasuredFeature) -> FeatureMark:
    """Return where a feature should be."""
    case = found.tried.case
    return FeatureMark(
        name=found.shape.name,
        kind=case.target.kind,
        pose=Pose(x_um=case.x_um, y_um=case.y_um, theta_rad=case.target.theta_rad),
        z_um=case.focus_um,
        parameters=case.target.parameters,
        body=found.shape.body,
    )


def _trials(
    tried: Evaluation, chosen: ChainScore, seed: int
) -> tuple[TrialRecord, ...]:
    """Return what the chosen chain said of every trial that it had."""
    mine = tried.comparison.outcomes.by(chosen.chain)
    made = design(tried.case, 1 + max(o.trial for o in mine), seed)
    return tuple(
        TrialRecord(
            trial=trial.index,
            focus_um=trial.dz_um,
            magnification=trial.magnification,
            error_um=None if outcome.world_um is None else outcome.distance_um,
            failure=outcome.failure or "",
            wrong=is_wrong(tried.case, outcome),
        )
        for outcome, trial in ((each, made[each.trial]) for each in mine)
    )


def _pictures(
    task: Task, look: str, found: MeasuredFeature, memo: Memo
) -> Iterator[tuple[Shown, Picture]]:
    """Yield the pictures at the ends of the usable range, and that of the worst trial.

    A range without an end has none.
    """
    usable, case = found.usable, found.tried.case
    values = (*usable.focus_um, *usable.magnification)
    ends = zip(_ENDS, ("least", "most") * 2, values, usable.pictures, strict=True)
    for what, end, value, shown in ends:
        if shown is not None:
            path = f"{FOLDER}/{look}.{what}.{end}.png"
            yield Shown(what=what, value=value, image=path), shown
    worst = found.chosen.worst_trial
    if worst is not None:
        seen = memo.call(image, case, rebuild(case, task.seed, worst))
        path = f"{FOLDER}/{look}.worst.png"
        yield Shown(what="worst", value=float(worst), image=path), picture(seen)
