"""The first page, to be passed on: verdict, margin, fixes, yield, depth, methods."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from microplan.planner.report.budgets import offenders_table, yield_figure
from microplan.planner.report.errors import error_picture
from microplan.planner.report.folder import ReportedPlan
from microplan.planner.report.margins import (
    Margin,
    margins,
    methods,
    needed_probability,
)
from microplan.planner.report.sketched import sketch_contents
from microplan.planner.report.steps import left_out, step_id
from microplan.planner.store.summary import (
    NOT_SHOWN,
    ends_before,
    lower_words,
    outside_words,
)
from microplan.schemas.files.evidence import LookEvidence
from microplan.schemas.files.times import spans
from microplan.schemas.page.axes import AxisScale, ChartField, around
from microplan.schemas.page.charts import Bar, bars, curve
from microplan.schemas.page.elements import Element, Node, el
from microplan.schemas.page.figures import (
    MICRO,
    chance,
    number,
    seconds,
    signed,
    span,
    um,
)
from microplan.schemas.page.page import Caption, Column, facts, figure, link, table
from microplan.schemas.plan import Look, Plan, Step

_MOST_LOOKS = 5  # on the first page, the narrowest


def first_page(folder: ReportedPlan) -> Element:
    """Return the first page, the summary of the whole plan."""
    plan = folder.plan
    if plan.is_sketch:
        return el("section", _verdict(plan), class_="first", id="verdict")
    found = margins(plan)
    figures = [_yield(folder), error_picture(folder), _depth(folder)]
    return el(
        "section",
        _verdict(plan),
        _tightest(found, whole=plan.status == "feasible"),
        facts(_facts(folder)),
        _offenders(plan, found),
        el("div", [f for f in figures if f is not None], class_="cols"),
        el("h2", "Methods"),
        methods(folder),
        class_="first",
        id="verdict",
    )


def _verdict(plan: Plan) -> list[Node]:
    """Return the verdict, with the reasons against the plan."""
    kind = {"feasible": " good", "infeasible": " bad"}.get(plan.status, "")
    lead = el("p", el("span", plan.status.capitalize(), class_=f"verdict{kind}"),
              f": {_chance(plan)}.", class_="lead")  # fmt: skip
    reasons = [
        el("li", el("strong", reason.code), " ",
           [_step_link(plan, reason.step), ": "] if reason.step else None,
           reason.message)
        for reason in plan.reasons
    ]  # fmt: skip
    help_ = sorted({f"microplan explain {reason.code}" for reason in plan.reasons})
    mend = el("p", "How to mend it: ", [[el("code", h), " "] for h in help_])
    outside = outside_words(plan)
    return [
        lead,
        el("p", f"{outside[0].upper()}{outside[1:]}.") if outside else None,
        [el("ul", reasons), mend] if reasons else None,
    ]


def _step_link(plan: Plan, step: str) -> Node:
    known = any(each.id == step for each in plan.steps)
    return link(step, step_id(step)) if known else step


def _chance(plan: Plan) -> str:
    """Return the probability of success, or where the plan ends."""
    if plan.is_sketch:
        return f"{NOT_SHOWN}, as nothing was tried"
    ends = ends_before(plan)
    if ends is not None:
        return f"the plan ends before {ends}, so that P(success) is not worked out"
    goal = "" if plan.success_goal is None else f", goal {number(plan.success_goal)}"
    return (
        f"P(success) {chance(plan.success_probability)}{lower_words(plan)}{goal}, by "
        "simulation alone"
    )


def _tightest(found: list[Margin], *, whole: bool) -> Element | None:
    """Return the tightest margin as a sentence."""
    if not found:
        return None
    tight = found[0]
    words = "Tightest margin: " if whole else "Tightest margin of what was worked out: "
    room = (
        f"{number(tight.ratio)} times what is needed"
        if tight.ratio >= 1
        else f"only {number(tight.ratio)} of what is needed"
    )
    return el(
        "p", el("strong", words), link(tight.step, step_id(tight.step)),
        f", {tight.subject}: {tight.has}, {tight.needs}; room {room}.",
    )  # fmt: skip


def _facts(folder: ReportedPlan) -> list[tuple[str, Node]]:
    """Return the plan's figures."""
    plan, looks = folder.plan, folder.looks
    times = spans(plan, folder.world)
    total = sum(span.total_s for span in times)
    without = left_out(times)
    small = el("small", f"without {without}") if total and without else None
    zooms = sorted({look.view.magnification for look in looks})
    return [
        ("steps", str(len(plan.steps))),
        ("looks", str(len(looks))),
        ("magnification", ", ".join(f"{number(z)} \u00d7" for z in zooms) or "\u2013"),
        ("time, all seen at first", [seconds(total) if total else "\u2013", small]),
    ]


def worst_step(plan: Plan) -> Step | None:
    """Return the step with a budget that is the least likely, None if none has one."""
    found = [s for s in plan.steps if s.budget.analysis is not None]
    return min(found, key=lambda s: s.budget.success_probability, default=None)


def _offenders(plan: Plan, found: list[Margin]) -> list[Node]:
    """Return the three worst offenders with the cheapest fix of each."""
    step = worst_step(plan)
    analysis = None if step is None else step.budget.analysis
    if step is None or analysis is None or not analysis.offenders:
        return _tight_looks(found, has_budget=step is not None)
    worst = offenders_table(plan, step, analysis.offenders[:3], label="Worst offenders")
    return [
        el("h2", f"Three worst offenders of {step.id}, P(success) "
           f"{chance(step.budget.success_probability)}"),
        worst,
        el("p", _cheapest(plan, step)),
    ]  # fmt: skip


def _cheapest(plan: Plan, step: Step) -> str:
    """Return the cheapest change for a step, or that none is needed."""
    analysis, needed = step.budget.analysis, needed_probability(plan, step)
    first = next(iter(() if analysis is None else analysis.changes), None)
    met = needed is not None and step.budget.success_probability >= needed
    if first is None:
        return step.budget.advice or "No change is needed: the goal is met."
    change = f"{first.what}, P(success) then {chance(first.success_probability)}."
    if met:
        share = f"What would give {step.id} its share of the goal: {change}"
        return f"No change is needed: the goal is met. {share}"
    return f"Cheapest change of all: {change}"


def _tight_looks(found: list[Margin], *, has_budget: bool) -> list[Node]:
    """Return what has the least room where no step has an error budget."""
    if not found:
        return []
    why = (
        "The error budget has no term that could be made less"
        if has_budget
        else "No step that was worked out inserts or places a part, so there is no "
        "error budget"
    )
    rows = [
        [link(m.step, step_id(m.step)), m.subject, m.has, m.needs,
         "it holds" if m.ratio >= 1 else "does not hold as it is"]
        for m in found[:3]
    ]  # fmt: skip
    columns = (Column("step"), Column("what"), Column("is", numeric=True),
               Column("must be", numeric=True), Column("verdict"))  # fmt: skip
    return [
        el("h2", "Least room"),
        el("p", f"{why}; of what was worked out this has the least room."),
        table(columns, rows, label="Least room"),
    ]  # fmt: skip


def _yield(folder: ReportedPlan) -> Element | None:
    """Return the yield over a size, or over the error that trials had."""
    step = worst_step(folder.plan)
    analysis = None if step is None else step.budget.analysis
    if step is not None and analysis is not None and analysis.yields:
        return yield_figure(folder.plan, step, analysis.yields[0], short=True)
    looks = [m.look for m in margins(folder.plan) if m.look]
    for name in looks:
        look = next(each for each in folder.looks if each.id == name)
        evidence = folder.evidence.get(name)
        if evidence is not None and evidence.trials:
            return _share_figure(look, evidence)
    return None


def _share_figure(look: Look, evidence: LookEvidence) -> Element:
    """Return the share of trials measured within each error."""
    errors = sorted(t.error_um for t in evidence.trials if t.error_um is not None)
    count, tolerance = len(evidence.trials), look.evidence.tolerance_um
    points = [(0.0, 0.0)]
    points += [(e, (k + 1) / count) for k, e in enumerate(errors)]
    axes = ChartField(
        across=around([0.0, tolerance, *errors], zero=True),
        up=AxisScale(low=0.0, high=1.04),
        across_label="error, \u00b5m",
        up_label="share of trials",
        height=196,
    )
    drawing = curve(
        f"Share of {count} trials of {look.id} measured within an error",
        f"The tolerance is {um(tolerance)}.",
        axes,
        points,
        here=tolerance,
        dots=False,
    )
    return figure(
        Caption(
            title=f"Yield of the look {look.id}",
            shows=f"The share of its {count} trials measured within an error; the "
            f"upright line is the tolerance, {um(tolerance)}.",
            judge="Good: the curve is at the top well before the line; bad: it still "
            "rises there.",
            do="If it does, look closer or let the tolerance grow.",
        ),
        drawing,
    )


def _depth(folder: ReportedPlan) -> Element | None:
    """Return the depth of field compared with the routines' usable focus range."""
    looks = sorted(
        folder.looks,
        key=lambda la: la.measure.usable_focus_um[1] - la.measure.usable_focus_um[0],
    )
    if not looks:
        return None
    depths = sorted({d for look in looks if (d := depth_um(look)) is not None})
    rows = []
    for look in looks[:_MOST_LOOKS]:
        low, high = look.measure.usable_focus_um
        said = f"{signed(low)} \u2026 {signed(high)} \u00b5m"
        rows.append(
            Bar(label=look.id, pieces=((high - low, ""),), said=said, start=low)
        )
    least = min(row.start for row in rows) * 1.1 or -1.0
    words = "; ".join(f"{row.label} {row.said}" for row in rows)
    joint = " to " if len(depths) > 2 else " and "
    ends = [um(d) for d in dict.fromkeys((depths[0], depths[-1]))] if depths else []
    textbook = joint.join(ends) or "not known"
    half = depths[-1] / 2 if depths else 0.0
    chart = bars(f"Usable focus of {len(rows)} looks", words, rows, least=least,
                 unit="error of the focus, \u00b5m", band=(-half, half))  # fmt: skip
    others = len(looks) - len(rows)
    more_ = f"; {others} further looks stand more" if others > 0 else ""
    caption = Caption(
        title=f"Depth of field: {textbook}",
        shows="The errors of focus at which each look was still measured within its "
        "tolerance at the nominal zoom, the narrowest first, over the lens's depth of "
        f"field as a band, {textbook} from end to end{more_}.",
        judge="Good: ranges several times the repeatability of your focus; bad: one "
        "that ends within the band.",
        do=_focus_advice(looks),
    )
    return figure(caption, chart)


def _focus_advice(looks: Sequence[Look]) -> str:
    """Return the focus error that all looks tolerate at the nominal zoom."""
    low = max(look.measure.usable_focus_um[0] for look in looks)
    high = min(look.measure.usable_focus_um[1] for look in looks)
    if low > high:
        return "No one focus error suits all: set the focus for each look."
    within = span(low, high, f"{MICRO}m")
    return (
        f"Keep the focus within {within} of nominal: with the zoom at nominal all "
        "looks stand it, with both off perhaps less, as the looks' maps show."
    )


def depth_um(look: Look) -> float | None:
    """Return the depth of field of a look's lens, from end to end."""
    if look.verdict is None:
        return None if look.measure.depth is None else look.measure.depth.textbook_um
    chosen = [row.depth_um for row in look.verdict.apertures if row.chosen]
    return chosen[0] if chosen else None


def contents(folder: ReportedPlan) -> Iterator[tuple[str, str]]:
    """Yield name and id of the page's sections."""
    yield "Verdict", "verdict"
    if folder.plan.is_sketch:
        yield from sketch_contents(folder)
    else:
        yield "Timeline", "timeline"
    for k, step in enumerate(folder.plan.steps, 1):
        yield f"{k}. {step.id}", step_id(step.id)
    if folder.findings:
        yield "Findings", "findings"
    yield "Provenance", "provenance"
