"""Margins of a plan in the report, with the methods paragraph to paste."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from microplan.planner.report.folder import ReportedPlan
from microplan.schemas.page.elements import Element, Node, el
from microplan.schemas.page.figures import degrees, number, um
from microplan.schemas.page.page import Column, Row, table
from microplan.schemas.plan import Look, Plan, Score, Step

# that of `microplan.optics.ledger`, without loading scipy for it
CONTRAST = "unit contrast"


def methods(folder: ReportedPlan) -> Element:
    """Return a paragraph that says how the numbers were made, to be pasted."""
    plan, p = folder.plan, folder.plan.provenance
    trials = max(
        (s.trials for look in folder.looks for s in
         (look.evidence.chosen, *look.evidence.others)), default=0,
    )  # fmt: skip
    needs = plan.requirements
    versions = ", ".join(
        f"{name} {said}"
        for name, said in folder.versions.items()
        if name != "microplan"
    )
    libraries = f" ({versions})" if versions else ""
    text = (
        f"The assembly {plan.name} was planned with microplan "
        f"{p.microplan}{libraries}, "
        f"preset {p.preset}, seed {p.seed}, after Feddema and Simon, CAD-Driven "
        "Microassembly and Visual Servoing, ICRA 1998. Images of "
        f"{needs.width_px} \u00d7 {needs.height_px} pixels of {number(needs.pitch_um)} "
        "\u00b5m were predicted from the parts' drawings by incoherent Fourier "
        f"optics; {_errors(folder)} Chains of image routines were tried on up to "
        f"{trials} images a "
        "look with focus, magnification, light and pose disturbed; the chances follow "
        "from the error budget. All of it is simulated. "
    )
    hashes = (
        f"SHA-256 of plan.json {folder.sha256}; of the normalised task "
        f"{p.task_sha256}; "
        f"of the workcell {p.workcell_sha256}."
    )
    return el("p", text, el("span", hashes, class_="hash"), class_="methods")


def _errors(folder: ReportedPlan) -> str:
    """Return what images may err by: what was aimed at, and what the ledgers leave."""
    aim = folder.plan.provenance.max_image_error
    rows = [row for look in folder.looks for row in look.effects]
    worst = max(
        (r.predicted_error or 0.0 for r in rows if r.unit == CONTRAST), default=0
    )
    text = f"each effect was to stay within {number(aim)} of unit contrast"
    if worst <= aim:
        return f"{text}, and does where the effects ledgers give a number."
    costs = [look.model_cost for look in folder.looks if look.model_cost is not None]
    most = max((max(c.half_width_um) for c in costs), default=0.0)
    paid = f", which pairs of images charge to positions as up to {um(most)}"
    text += f"; by the effects ledgers up to {number(worst, 2)} is left"
    return f"{text}{paid if costs else ''}."


def provenance(folder: ReportedPlan) -> Element:
    """Return every version and hash as a table."""
    p = folder.plan.provenance
    rows: list[Row] = [
        ["plan.json, SHA-256", el("code", folder.sha256)],
        ["plan format", folder.plan.format_version],
        ["task, normalised", el("code", p.task_sha256)],
        ["workcell, normalised", el("code", p.workcell_sha256)],
        *(_row(f"drawing of {name}", el("code", digest))
          for name, digest in p.drawings_sha256.items()),
        ["seed", str(p.seed)],
        ["preset", p.preset],
        ["images: error aimed at", f"{number(p.max_image_error)} of unit contrast"],
        *(_row(name, said) for name, said in folder.versions.items()),
    ]  # fmt: skip
    return table((Column("what"), Column("value")), rows, label="Provenance")


def _row(name: str, value: Node) -> Row:
    return [name, value]


@dataclass(frozen=True, slots=True, kw_only=True)
class Margin:
    """One thing that must hold, and how far it is from not holding."""

    step: str
    subject: str  # what has the margin, in a few words
    has: str
    needs: str
    ratio: float  # room over need; below 1 it does not hold
    look: str = ""  # id, where it is a look's


def margins(plan: Plan) -> list[Margin]:
    """Return all margins of a plan that it has numbers for, the tightest first."""
    found = [margin for step in plan.steps for margin in _of_step(plan, step)]
    return sorted(found, key=lambda margin: margin.ratio)  # stable: else in order


def needed_probability(plan: Plan, step: Step) -> float | None:
    """Return what a step must reach for the plan's goal, the others as they are.

    The step's share of the goal where that cannot be said: the plan ends early, has no
    goal, or fails it whatever this step does. None if the step has no budget.
    """
    if step.budget.analysis is None:
        return None
    share = step.budget.analysis.required_probability
    if plan.success_goal is None or not step.budget.success_probability > 0:
        return share
    others = min(plan.success_probability / step.budget.success_probability, 1.0)
    return plan.success_goal / others if others > plan.success_goal else share


def need_um(score: Score) -> float | None:
    """Return what a chain needs of a tolerance, 2 sigma + |bias|; None if unknown."""
    if score.sigma_um is None or score.bias_um is None:
        return None
    return 2 * score.sigma_um + math.hypot(*score.bias_um)


def _of_step(plan: Plan, step: Step) -> Iterator[Margin]:
    """Yield the margins of one step."""
    for look in step.looks:
        yield from _of_look(step, look)
    analysis, missing = step.budget.analysis, 1 - step.budget.success_probability
    needed = needed_probability(plan, step)
    if analysis is not None and needed is not None:
        if analysis.miss_probability is not None:
            missing = analysis.miss_probability
        allowed = 1 - needed
        yield Margin(
            step=step.id,
            subject=f"chance that {step.verb} misses",
            has=f"{number(100 * missing)} %",
            needs=f"at most {number(100 * allowed)} %",
            ratio=allowed / missing if missing > 0 else math.inf,
        )
    if step.grasp is not None:
        yield Margin(
            step=step.id,
            subject="room beside the part for the fingers",
            has=um(step.grasp.room_um),
            needs=f"at least {um(step.grasp.needed_um)}",
            ratio=_ratio(step.grasp.room_um, step.grasp.needed_um),
        )
    if step.fit is not None and step.fit.tilt_limit_rad is not None:
        yield Margin(
            step=step.id,
            subject="tilt of the axes, 3 sigma",
            has=degrees(step.fit.tilt_rad),
            needs=f"at most {degrees(step.fit.tilt_limit_rad)}",
            ratio=_ratio(step.fit.tilt_limit_rad, step.fit.tilt_rad),
        )


def _of_look(step: Step, look: Look) -> Iterator[Margin]:
    """Yield the margin of a look: its tolerance over what the trials needed of it."""
    tolerance = look.evidence.tolerance_um
    needed = need_um(look.evidence.chosen)
    if look.together is not None:
        needed = 2 * look.together.sigma_xy_um
    if needed is not None:
        yield Margin(
            step=step.id,
            look=look.id,
            subject=f"error of the look at {look.target}",
            has=um(needed),
            needs=f"at most {um(tolerance)}",
            ratio=_ratio(tolerance, needed),
        )


def _ratio(room: float, need: float) -> float:
    return room / need if need > 0 else math.inf
