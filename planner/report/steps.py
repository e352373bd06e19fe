"""Steps in the report: figures, looks, budget, verdicts, the timeline of all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from microplan.planner.report.budgets import budget_figures
from microplan.planner.report.folder import ReportedPlan
from microplan.planner.report.looks import ledger, look_section
from microplan.schemas.files.times import StepTimes, spans
from microplan.schemas.files.world import World
from microplan.schemas.page.charts import Bar, bars
from microplan.schemas.page.elements import Element, Node, el, slug
from microplan.schemas.page.figures import (
    chance,
    degrees,
    number,
    quantity,
    seconds,
    um,
)
from microplan.schemas.page.page import Caption, Column, facts, figure, more, table
from microplan.schemas.plan import Plan, Step
from microplan.schemas.plan.verdicts import (
    FitVerdict,
    Force,
    GraspVerdict,
    PlacingVerdict,
    ReleaseVerdict,
)


def timeline(plan: Plan, world: World | None) -> Iterator[Element]:
    """Yield the timeline of the task."""
    found = spans(plan, world)
    if not found:
        return
    rows, at = [], 0.0
    for span in found:
        pieces = ((span.axes_s, "b1"), (span.lens_s, "b2"), (span.frames_s, "b3"),
                  (span.servo_s, ""))  # fmt: skip
        said = _said(span)
        rows.append(Bar(label=span.step, pieces=pieces, said=said, start=at))
        at += span.total_s
    words = "; ".join(f"{row.label} {row.said}" for row in rows)
    chart = bars(f"Timeline, {seconds(at)} in all", words, rows, unit="seconds",
                 most=max(at, 1e-6) * 1.02)  # fmt: skip
    caption = Caption(
        title=f"Timeline: about {seconds(at)}",
        shows="When each step happens if every look finds its target at the first try: "
        "axes moving and settling, zoom and focus, exposures, and the further looks "
        f"of a servo; light has no stated time{_lacking(found)}.",
        judge="Good: the long bars are those that must be slow, as an insertion; bad: "
        "zoom and focus take most of it.",
        do="To save time, order looks of one magnification and focus behind each "
        "other.",
    )
    key = [("b1", "axes"), ("b2", "zoom and focus"), ("b3", "exposure"),
           ("", "servo")]  # fmt: skip
    legend = el("ul", [el("li", _swatch(kind), words) for kind, words in key],
                class_="key plain")  # fmt: skip
    yield figure(caption, chart, legend)


def _swatch(kind: str) -> Element:
    box = el("rect", x=2, y=3, width=24, height=8, class_=f"bar {kind}".strip())
    return el("svg", box, viewBox="0 0 28 14", aria_hidden="true")


def left_out(found: Sequence[StepTimes]) -> str:
    """Return what the times of steps leave out, and of which steps; "" if nothing."""
    things = dict.fromkeys(thing for span in found for thing in span.lacks)
    return "; ".join(
        f"{thing} of {', '.join(s.step for s in found if thing in s.lacks)}"
        for thing in things
    )


def _lacking(found: Sequence[StepTimes]) -> str:
    words = left_out(found)
    return f", nor is the time known of {words}" if words else ""


def _said(span: StepTimes) -> str:
    """Return how long a step takes, as far as it is known."""
    if not span.lacks:
        return seconds(span.total_s)
    return f"more than {seconds(span.total_s)}" if span.total_s else "no time stated"


def step_id(step: str) -> str:
    """Return the id of a step's section."""
    return slug("step", step)


def step_title(step: Step) -> str:
    """Return what a step does, in a few words."""
    action = step.action
    other = getattr(action, "to", None) or getattr(action, "onto", None)
    other = other or getattr(action, "on", None)
    target = getattr(action, "target", "")
    words = {"align": "to", "insert": "onto", "verify": "on"}
    said = f"{step.verb} {target}".strip()
    return (
        f"{said} {words[step.verb]} {other}" if other and step.verb in words else said
    )


def step_section(folder: ReportedPlan, number_: int, step: Step) -> Element:
    """Return everything about one step."""
    return el(
        "section",
        el("h2", f"{number_}. {step.id}: {step_title(step)}"),
        facts(_facts(folder.plan, step)),
        el("p", step.budget.advice, class_="note") if step.budget.advice else None,
        [*_verdicts(step)],
        [*budget_figures(folder.plan, step)],
        [look_section(folder, look) for look in step.looks],
        ledger(step.effects, f"the step {step.id}"),
        id=step_id(step.id),
    )


def _low(plan: Plan, step: Step) -> Element | None:
    """Return the lower bound of the step's probability, None where it has none."""
    rows = () if plan.success_bound is None else plan.success_bound.steps
    low = next((row.success_low for row in rows if row.step == step.id), None)
    return None if low is None else el("small", f"at least {chance(low)}")


def _facts(plan: Plan, step: Step) -> list[tuple[str, Node]]:
    """Return the step's figures."""
    found: list[tuple[str, Node]] = [
        ("P(success)", [chance(step.budget.success_probability), _low(plan, step)]),
        ("looks", str(len(step.looks)) if step.looks else "none"),
        ("can it be undone", "no" if step.irreversible else "yes"),
    ]
    control = step.control
    if control is not None:
        found += [
            ("method", control.method.replace("_", " ")),
            ("aligned within", um(control.tolerance_xy_um)),
            ("looks expected", number(control.expected_cycles, 2)),
            ("time expected", seconds(control.approach_s + control.expected_s)),
        ]
        if control.choice is not None:
            found.append(("why this method", el("small", control.choice.reason)))
    return found


def _verdicts(step: Step) -> Iterator[Element]:
    """Yield what the mechanics say of a step."""
    if step.fit is not None:
        yield el("h3", "Fit")
        yield facts(_fit(step.fit))
    if step.grasp is not None:
        yield el("h3", f"Grasp: {step.grasp.verdict}")
        yield el("p", f"{_sentence(step.grasp.reason)}.")
        yield facts(_grasp(step.grasp))
    if step.release is not None:
        yield el("h3", f"Release: {step.release.verdict}")
        yield el("p", f"{_sentence(step.release.reason)}.")
        yield facts(_release(step.release))
        yield more("Forces, as intervals", _forces(step.release))
        if step.release.ladder:
            rows = [[r.action, r.why] for r in step.release.ladder]
            columns = (Column("if it sticks"), Column("why"))
            yield more("What to try if it sticks", table(columns, rows))
    if step.placing is not None:
        yield el("h3", "Where it comes to lie")
        yield facts(_placing(step.placing))


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _fit(fit: FitVerdict) -> list[tuple[str, Node]]:
    low, drawn, high = fit.clearance_um
    tilt = degrees(fit.tilt_limit_rad)
    return [
        ("fit", fit.fit),
        ("hole over shaft", f"{um(fit.hole_um)} over {um(fit.shaft_um)}"),
        ("clearance", [um(drawn), el("small", f"{um(low)} to {um(high)} as made")]),
        ("capture radius as drawn",
         [um(_capture_um(fit)), el("small", f"{um(fit.capture_um[0])} at the least")]),
        ("tilt, 3 sigma", [degrees(fit.tilt_rad), el("small", f"limit {tilt}")]),
        ("may wedge", "yes" if fit.may_wedge else "no"),
    ]  # fmt: skip


def _capture_um(fit: FitVerdict) -> float:
    """Return the capture radius as drawn, less the taper, as budgets have it."""
    return max(fit.capture_um[1] - fit.taper_um / 2, 0.0)


def _grasp(grasp: GraspVerdict) -> list[tuple[str, Node]]:
    force, missed = grasp.force_un, grasp.theta_miss_probability
    rows: list[tuple[str, Node]] = [
        ("jaws open to", um(grasp.opening_um)),
        ("part between them", um(grasp.width_um)),
        ("room on the narrow side",
         [um(grasp.room_um), el("small", f"{um(grasp.needed_um)} needed")]),
        ("squeezed by", "not known" if force is None else _forces_un(force)),
        ("lifting takes", _forces_un(grasp.lift_un)),
    ]  # fmt: skip
    if missed is not None:
        rows.append(("P(turned to the planned angle)", chance(1 - missed)))
    return rows


def _release(release: ReleaseVerdict) -> list[tuple[str, Node]]:
    return [
        ("pulls it along", _forces_un(release.pull_un)),
        ("holds it", _forces_un(release.hold_un)),
        ("weight", _forces_un(release.weight_un)),
        ("looked at by", release.verified_by or "no step"),
    ]


def _placing(placing: PlacingVerdict) -> list[tuple[str, Node]]:
    return [
        ("half of all lie within", um(placing.half_um)),
        ("95 % lie within", [um(placing.most_um),
                             el("small", f"{um(placing.within_um)} allowed")]),
        ("P(place)", chance(placing.place_probability)),
        ("one sigma of the angle", degrees(placing.turn_sigma_rad)),
        ("P(angle)", chance(placing.turn_probability)),
    ]  # fmt: skip


def _forces_un(pair: tuple[float, float]) -> str:
    """Return an interval of forces; one number where its ends read the same."""
    low, high = number(pair[0], 2), number(pair[1], 2)
    most = quantity(pair[1], "\u00b5N", 2)
    return most if low == high else f"{low} to {most}"


def _forces(release: ReleaseVerdict) -> Element:
    """Return the forces of a release."""
    columns = (Column("force"), Column("between"), Column("size", numeric=True),
               Column("where the formula holds"))  # fmt: skip
    rows = [_force(f, "part and finger") for f in release.finger]
    rows += [_force(f, "part and support") for f in release.holding]
    return table(columns, rows)


def _force(force: Force, between: str) -> list[Node]:
    return [force.name, between, _forces_un((force.least_un, force.most_un)),
            force.validity]  # fmt: skip
