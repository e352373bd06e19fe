"""One step in the report: its figures, its looks, its budget and its verdicts."""

from __future__ import annotations

from collections.abc import Iterator

from microplan.planner.report.budgets import budget_figures
from microplan.planner.report.folder import ReportedPlan
from microplan.planner.report.ledger import ledger
from microplan.planner.report.looks import look_section
from microplan.schemas.page.elements import Element, Node, el, slug
from microplan.schemas.page.figures import (
    chance,
    degrees,
    number,
    quantity,
    seconds,
    um,
)
from microplan.schemas.page.page import Column, facts, more, table
from microplan.schemas.plan import Step
from microplan.schemas.plan.verdicts import (
    FitVerdict,
    Force,
    GraspVerdict,
    PlacingVerdict,
    ReleaseVerdict,
)


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
        facts(_facts(step)),
        el("p", step.budget.advice, class_="note") if step.budget.advice else None,
        [*_verdicts(step)],
        [*budget_figures(folder.plan, step)],
        [look_section(folder, look) for look in step.looks],
        ledger(step.effects, f"the step {step.id}"),
        id=step_id(step.id),
    )


def _facts(step: Step) -> list[tuple[str, Node]]:
    """Return the step's figures."""
    found: list[tuple[str, Node]] = [
        ("P(success)", chance(step.budget.success_probability)),
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
    force = grasp.force_un
    return [
        ("jaws open to", um(grasp.opening_um)),
        ("part between them", um(grasp.width_um)),
        ("room on the narrow side",
         [um(grasp.room_um), el("small", f"{um(grasp.needed_um)} needed")]),
        ("squeezed by", "not known" if force is None else _forces_un(force)),
        ("lifting takes", _forces_un(grasp.lift_un)),
    ]  # fmt: skip


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
