"""Verdicts of the gear-on-shaft example for thinner and thicker pins.

`python -m benchmarks.compiling.pins PLAN` prints the table of docs/verdicts.md. Looks
are those of the plan, by default the golden one at preset `fast`: a pin's own diameter
moves their sigmas by less than the other terms. Tolerances, methods and chances are
worked out anew for every pin.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from microplan.optics.outline.offset import offset
from microplan.planner.assembly.assembly import owner_of
from microplan.planner.assembly.mating import mating_of
from microplan.planner.assembly.step_states import unfold
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.control import tolerance_um
from microplan.planner.budget.insert_budget import (
    insert_budget,
    insertion_of,
    share_of_goal,
)
from microplan.planner.budget.measurement_history import MeasurementHistory
from microplan.planner.budget.methods import method_of
from microplan.planner.budget.step_budget import left_of
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from microplan.schemas.plan import Budget, Plan, parse_plan

ROOT = Path(__file__).parents[2]
TASK = ROOT / "examples" / "gear_on_shaft" / "task.yaml"
GOLDEN = ROOT / "tests" / "golden" / "gear_on_shaft.fast.json"
PINS_UM = (35.0, 40.0, 44.0, 47.0, 49.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What comes of one pin."""

    pin_um: float
    fit: str
    least_um: float  # clearance
    within_um: float  # of the alignment
    chances: Mapping[str, float]  # by method
    method: str
    goal: float
    budget: Budget


def verdict(task: Task, plan: Plan, pin_um: float) -> Verdict:
    """Return the verdict of the example with a pin of another diameter."""
    changed = with_pin(task, pin_um)
    states = unfold(changed, Report())
    align = next(s for s in states if s.step.id == "over_shaft")
    insert = next(s for s in states if s.step.verb == "insert")
    seen = sightings(plan, insert.step.id)
    before = sightings(plan, align.step.id)[owner_of(align.step.target or "")]
    memory = MeasurementHistory(
        magnification=0.0, seen=seen, within_um=0.0, key="", before=before
    )
    hole = seen.get(owner_of(insert.step.target or ""))
    within = tolerance_um(changed, states, align, hole)
    choice = method_of(changed, states, align, within, seen, Report(), before)
    memory = replace(memory, within_um=within, choice=choice)
    left, goal = left_of(changed, states, insert, memory), share_of_goal(changed)
    job = insertion_of(changed, states, insert, left, memory.seen)
    mating = mating_of(changed, insert.step, insert.after)
    if job is None or mating is None:
        raise ValueError("the example inserts no round hole over a post")
    chances: dict[str, float] = {
        o.method: o.success_probability or 0.0 for o in choice.options
    }
    others = [(m, p) for m, p in chances.items() if m != choice.method]
    budget = insert_budget(job, left, goal=goal, methods=others)
    return Verdict(
        pin_um=pin_um,
        fit=mating.fit_class,
        least_um=mating.clearance_um[0],
        within_um=within,
        chances=chances,
        method=choice.method,
        goal=goal,
        budget=budget,
    )


def with_pin(task: Task, pin_um: float) -> Task:
    """Return the task with another diameter of the post."""
    plate = task.parts["shaft_plate"]
    drawn = plate.posts["post"]
    wider_um = pin_um / 2 - drawn.radius_um
    outline = drawn.outline if wider_um == 0 else offset(drawn.outline, wider_um)
    post = replace(drawn, radius_um=pin_um / 2, outline=outline)
    parts = {**task.parts, "shaft_plate": replace(plate, posts={"post": post})}
    return replace(task, parts=parts)


def sightings(plan: Plan, until: str) -> dict[str, PastMeasurement]:
    """Return the last look at every owner before a step."""
    found = {}
    for step in plan.steps:
        if step.id == until:
            break
        for look in step.looks:
            pose = look.measure.reference.pose
            found[owner_of(look.target)] = PastMeasurement(
                name=look.target,
                step=step.id,
                sigma_um=look.sigma_xy_um,
                magnification=look.view.magnification,
                focus_um=look.view.focus_um,
                distortion_sigma_um=0.0,  # of circles at the middle of the field
                coherence_um=0.0,
                place_um=(pose.x_um, pose.y_um),
            )
    return found


def table(found: tuple[Verdict, ...]) -> str:
    """Return the verdicts as a table in Markdown."""
    lines = [
        "| pin um | fit | least um | within | servo | one look | method | goal | is |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for v in found:
        chance = v.budget.success_probability
        says = "feasible" if chance >= v.goal else "infeasible"
        lines.append(
            f"| {v.pin_um:g} | {v.fit} | {v.least_um:.2f} | {v.within_um:.2f} | "
            f"{v.chances['servo']:.4f} | {v.chances['look_then_move']:.4f} | "
            f"{v.method} | {v.goal:.4f} | {says} |"
        )
    return "\n".join(lines)


def mending(found: Verdict) -> str:
    """Return what would make a pin feasible, and what each term costs."""
    analysis = found.budget.analysis
    if analysis is None:
        raise ValueError("an insertion's budget is analysed")
    lines = [f"A pin of {found.pin_um:g} um, by what would do, the cheapest first:", ""]
    lines += [
        f"- {c.what} ({c.halvings:.1f} halvings): P {c.success_probability:.4f}"
        for c in analysis.changes
    ] or ["- nothing: it is feasible, or no single change would do"]
    lines += ["", "| term | um | dP/d(term) per um | P if halved | largest um |"]
    lines.append("|---|---|---|---|---|")
    for o in analysis.offenders:
        most = "none" if o.largest_um is None else f"{o.largest_um:.3g}"
        lines.append(
            f"| {o.term} | {o.size_um:.3g} | {o.slope_per_um:.3g} | "
            f"{o.halved_probability:.4f} | {most} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Print the table, and what would mend the thickest pin."""
    report = Report()
    task = load_task(str(TASK), report)
    if task is None:
        raise SystemExit([d.message for d in report.found])
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else GOLDEN
    plan = parse_plan(path.read_text(encoding="utf-8"))
    found = tuple(verdict(task, plan, pin_um) for pin_um in PINS_UM)
    print(table(found))
    print()
    print(mending(found[-1]))


if __name__ == "__main__":
    main()
