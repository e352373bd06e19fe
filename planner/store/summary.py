"""A plan in a few lines of text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from microplan.schemas.files.times import SWEEP
from microplan.schemas.page.figures import chance
from microplan.schemas.plan import (
    SKETCH,
    Look,
    Measure,
    Plan,
    Step,
    VerifyAction,
)

NOT_SHOWN = "P not shown"  # by a plan without trials


def plan_summary(plan: Plan) -> str:
    """Return the verdict with what it leaves out, one line per step, and the rest."""
    if plan.is_sketch:
        return sketch_summary(plan)
    verdict = [f"{plan.name}: {plan.status}, {_chance(plan)}", *_outside(plan)]
    width = max((len(step.id) for step in plan.steps), default=4)
    steps = [f"{step.id:{width}}  {_step_line(step)}" for step in plan.steps]
    return "\n".join([*verdict, *steps, *_look_times(plan)])


def sketch_summary(plan: Plan) -> str:
    """Return the answer of a sketch, and one line per look."""
    against = "" if plan.status == SKETCH else f"{plan.status}; "
    width = max((len(look.id) for look in plan.sketched), default=4)
    lines = [
        f"{look.id:{width}}  {look.target} at {look.view.magnification:.3g} x, focus "
        f"at {look.view.focus_um:g} um; {look.scene.image}"
        for look in plan.sketched
    ]
    return "\n".join([f"{plan.name}: {against}sketch: {NOT_SHOWN}", *lines])


def success(plan: Plan) -> str:
    """Return the probability of success, as terminals and pages show it."""
    if plan.is_sketch:
        return "not shown"
    known = ends_before(plan) is None
    return chance(plan.success_probability) if known else "not worked out"


def ends_before(plan: Plan) -> str | None:
    """Return the step that a plan ends before, None if it has them all."""
    known = {step.id for step in plan.steps}
    return next((r.step for r in plan.reasons if r.step and r.step not in known), None)


def _chance(plan: Plan) -> str:
    """Return the probability of success, or where the plan ends before it is known."""
    ends = ends_before(plan)
    if ends is not None:
        return f"ends before {ends!r}, so that P(success) is not worked out"
    goal = "" if plan.success_goal is None else f", goal {plan.success_goal:g}"
    return f"P(success) {success(plan)}{lower_words(plan)}{goal} (simulated)"


def lower_words(plan: Plan) -> str:
    """Return the lower bound of the probability of success, "" where it is unknown."""
    bound = plan.success_bound
    if bound is None:
        return ""
    words = f", at least {chance(bound.success_low)} at {bound.confidence:g} confidence"
    words += f" by {bound.trials} random trials a look"
    if plan.success_goal is not None and bound.reachable < plan.success_goal:
        words += f", which show {chance(bound.reachable)} at most"
    return words


def left_out(steps: Sequence[Step]) -> tuple[str, ...]:
    """Return what steps may fail by without a known probability, one text a step."""
    found = []
    for step in steps:
        if step.grasp is not None and step.grasp.verdict != "holds":
            found.append(f"{step.id} ({step.grasp.verdict})")
        if step.fit is not None and step.fit.may_wedge:
            found.append(f"{step.id} (may wedge)")
        if step.release is not None and step.release.verdict != "stays":
            found.append(f"{step.id} ({step.release.verdict})")
    return tuple(found)


def outside_words(plan: Plan) -> str:
    """Return what the probability of success leaves out, "" if nothing is known."""
    doubtful = left_out(plan.steps)
    return f"not in P(success): {', '.join(doubtful)}" if doubtful else ""


def _outside(plan: Plan) -> list[str]:
    words = outside_words(plan)
    return [words] if words else []


def _look_times(plan: Plan) -> list[str]:
    """Return what all looks wait for, each seen once and at the first try."""
    verdicts = [look.verdict for step in plan.steps for look in step.looks]
    changes = [v.change for v in verdicts if v is not None and v.change is not None]
    if not changes:
        return []
    rows = [row for change in changes for row in change.times]
    shares = [
        (word, [row.time_s for row in rows if row.what.startswith(word)])
        for word in ("zoom", "focus", "exposure")
    ]
    words = tuple(word for word, _ in shares)
    axes_s = sum(row.time_s for row in rows if not row.what.startswith(words))
    total_s = sum(change.total_s for change in changes)
    said = ", ".join(f"{word} {sum(t):.3g} s ({len(t)})" for word, t in shares)
    head = "1 look takes" if len(changes) == 1 else f"{len(changes)} looks take"
    text = f"{head} {total_s:.3g} s, each once: {said}, axes {axes_s:.3g} s"
    sweeps = [step.id for step in plan.steps if _sweeps(step)]
    return [f"{text}; without {SWEEP} of {', '.join(sweeps)}" if sweeps else text]


def _sweeps(step: Step) -> bool:
    """Return whether a step moves the focus to find a height, after its looks."""
    return isinstance(step.action, VerifyAction) and step.action.height is not None


def _step_line(step: Step) -> str:
    """Return what matters of one step."""
    parts = [step.verb]
    parts += [_look_line(look) for look in step.looks]
    if step.control is not None:
        parts.append(
            f"{step.control.method} to {step.control.tolerance_xy_um:.3g} um, "
            f"{step.control.expected_cycles:.1f} looks"
        )
    if step.budget.success_probability < 1 and step.budget.rows:
        parts.append(f"P {chance(step.budget.success_probability)}")
    return "; ".join(parts)


def _look_line(look: Look) -> str:
    """Return what finds the target, and how well."""
    found = "; ".join(_found_by(measure) for measure in look.measures)
    low, high = look.measure.usable_focus_um
    draws = look.measure.usable_draws
    drawn = "" if draws is None else f" ({draws} draws)"
    return (
        f"{look.target} by {found} at {look.view.magnification:.3g} x, sigma "
        f"{look.sigma_xy_um:.2g} um, focus {low:+g}..{high:+g} um{drawn}"
    )


def _found_by(measure: Measure) -> str:
    """Return the routines that find a feature, and which, if it is not the target."""
    chain = " > ".join(use.id for use in measure.chain)
    return f"{chain} on {measure.feature}" if measure.feature else chain


def times_summary(timings: Mapping[str, float]) -> str:
    """Return what took how long, the longest first; `timings` as in timings.json."""
    total_s = timings.get("total_s", sum(timings.values()))
    rows = [(name.removesuffix("_s"), s) for name, s in timings.items()]
    rows = sorted((r for r in rows if r[0] != "total"), key=lambda row: -row[1])
    lines = [
        f"{seconds:9.3f} s {100 * seconds / total_s if total_s else 0.0:4.0f} %  "
        + name.removeprefix("steps.")
        for name, seconds in rows
    ]
    return "\n".join([*lines, f"{total_s:9.3f} s         in all"])
