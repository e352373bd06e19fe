"""The error budget of a step: its terms as bars, their effects, their fixes."""

from __future__ import annotations

import math
from collections.abc import Iterator

from microplan.planner.report.margins import needed_probability
from microplan.schemas.page.axes import AxisScale, ChartField, around
from microplan.schemas.page.charts import Bar, bars, curve
from microplan.schemas.page.elements import Element, el
from microplan.schemas.page.figures import chance, number, um
from microplan.schemas.page.page import Caption, Column, figure, more, table
from microplan.schemas.plan import Budget, BudgetRow, Plan, Step
from microplan.schemas.plan.verdicts import Offender, YieldCurve

LEFT_BY_SERVO = "left by the servo"  # how the term ends
_NAMES = {"within_um": "distance that is allowed"}


def budget_figures(plan: Plan, step: Step) -> Iterator[Element]:
    """Yield the error budget of a step, if it has one."""
    budget = step.budget
    known = [r for r in budget.rows if r.sigma_um]
    if known:
        yield figure(_caption(step), _bars(budget))
    if budget.rows:
        yield more(f"All terms of the budget: {len(budget.rows)}", _terms(budget))
    analysis = budget.analysis
    if analysis is None:
        return
    if analysis.offenders:
        yield el("h4", "What the chance hangs on")
        yield offenders_table(plan, step, analysis.offenders)
    if analysis.changes:
        rows = [[c.what, f"{number(c.halvings)}", chance(c.success_probability)]
                for c in analysis.changes]  # fmt: skip
        names = (Column("change"), Column("halvings", numeric=True),
                 Column("P(success) then", numeric=True))  # fmt: skip
        yield el("h4", "What would give its share of the goal, the cheapest first")
        yield table(names, rows)
    for one in analysis.yields:
        yield yield_figure(plan, step, one)
    if analysis.allowed:
        yield more("The largest errors of one setting that still give the goal",
                   _allowed(step))  # fmt: skip


def offenders_table(
    plan: Plan, step: Step, offenders: tuple[Offender, ...], *, label: str = ""
) -> Element:
    """Return error terms with what halving each would give, and the cheapest fix."""
    columns = (
        Column("error term"), Column("one sigma", numeric=True),
        Column("P if halved", numeric=True), Column("cheapest fix"),
    )  # fmt: skip
    rows = [
        [o.term, um(o.size_um), chance(o.halved_probability), fix(plan, step, o)]
        for o in offenders
    ]
    return table(columns, rows, label=label)


def fix(plan: Plan, step: Step, offender: Offender) -> str:
    """Return what the compiler knows of mending one term; nothing is guessed.

    The largest size that it knows is that which gives the step its share of the goal;
    others with room to spare may make up for a step that falls short of it.
    """
    largest, needed = offender.largest_um, needed_probability(plan, step)
    met = needed is not None and step.budget.success_probability >= needed
    if met and largest is not None and largest > offender.size_um:
        return f"none needed; may grow to {um(largest)}"
    if met and largest is not None and largest > 0:
        return f"none needed; {um(largest)} or less gives its share of the goal"
    if met:
        return "none needed"
    if largest is not None and largest > 0:
        return f"bring it from {um(offender.size_um)} to {um(largest)} or less"
    return "no size of this term alone gives the goal"


def yield_figure(
    plan: Plan, step: Step, one: YieldCurve, *, short: bool = False
) -> Element:
    """Return P(success) over one size, with what is drawn and what is needed."""
    required = needed_probability(plan, step)
    points = [(p.value_um, p.success_probability) for p in one.points]
    name, here = _NAMES.get(one.over, one.over), _here(step, one.over)
    if len(points) < 2:
        known = chance(points[0][1] if points else None)
        said = f"P(success) is {known} for any {name}."
        return el("p", said)
    axes = ChartField(
        across=around([x for x, _ in points]),
        up=AxisScale(low=0.0, high=1.04),
        across_label=f"{name}, \u00b5m",
        up_label="P(success)",
        height=196 if short else 224,
    )
    stands = "" if here is None else f"; the upright line is this plan's {um(here)}"
    drawing = curve(
        f"P(success) of {step.id} over the {name}",
        f"From {chance(points[0][1])} at {um(points[0][0])} to {chance(points[-1][1])} "
        f"at {um(points[-1][0])}.",
        axes,
        points,
        here=here,
        limit=required,
        limit_name="" if required is None else f"needed {chance(required)}",
    )
    caption = Caption(
        title=f"Yield over the {name}",
        shows=f"The chance that {step.id} succeeds if the {name} were another, all "
        f"else "
        f"as it is{stands}.",
        judge="Good: the plan stands on the flat top, above the dashed line that its "
        "goal needs; bad: on the slope.",
        do=yield_advice(points, required),
    )
    return figure(caption, drawing)


def yield_advice(points: list[tuple[float, float]], required: float | None) -> str:
    """Return which sizes still give the goal, where the drawn line crosses it."""
    if required is None:
        return "Choose a size on the flat top."
    enough = [x for x, p in points if p >= required]
    if not enough:
        return "No size on the curve gives the goal: change something else."
    low, high, why = min(enough), max(enough), "there the curve crosses the goal"
    if (low, high) == (points[0][0], points[-1][0]):
        return "Any size on the curve gives the goal."
    if low == points[0][0]:
        return f"Stay below about {um(_crossing(points, high, 1, required))}: {why}."
    if high == points[-1][0]:
        return f"Stay above about {um(_crossing(points, low, -1, required))}: {why}."
    ends = [_crossing(points, x, way, required) for x, way in ((low, -1), (high, 1))]
    return f"Stay within about {um(ends[0])} to {um(ends[1])}: {why}."


def _crossing(
    points: list[tuple[float, float]], last: float, way: int, required: float
) -> float:
    """Return where the line from the last size that gives the goal meets the goal."""
    at = next(k for k, (x, _) in enumerate(points) if x == last)
    (x0, p0), (x1, p1) = points[at], points[at + way]
    return x0 + (x1 - x0) * (p0 - required) / (p0 - p1)


def _here(step: Step, over: str) -> float | None:
    """Return the plan's own value of what a curve runs over, None if it is unknown."""
    if over == "diameter of the shaft" and step.fit is not None:
        return step.fit.shaft_um
    if over == "within_um" and step.placing is not None:
        return step.placing.within_um
    return None


def total_um(budget: Budget) -> float:
    """Return the root of the sum of squares of all terms."""
    return math.hypot(*(row.sigma_um or 0.0 for row in budget.rows))


def _bars(budget: Budget) -> Element:
    """Return the terms as bars, the largest first, all together and the limit."""
    known = sorted(
        (r for r in budget.rows if r.sigma_um), key=lambda r: -(r.sigma_um or 0.0)
    )
    rows = [Bar(label=r.term, pieces=((r.sigma_um or 0.0, ""),), said=um(r.sigma_um))
            for r in known]  # fmt: skip
    together = total_um(budget)
    rows.append(
        Bar(label="all together", pieces=((together, "sum"),), said=um(together))
    )
    words = ", ".join(f"{r.term} {um(r.sigma_um)}" for r in known)
    return bars(
        "Error budget, one sigma per axis",
        f"{words}; together {um(together)}; the limit is {um(budget.limit_um)}.",
        rows,
        limit=budget.limit_um,
        limit_name="limit",
        unit="\u00b5m",
    )


def _caption(step: Step) -> Caption:
    """Return the caption of the bars."""
    budget = step.budget
    together = total_um(budget)
    kind = {
        "insert": "the capture radius as drawn",
        "grasp": "the room beside the part",
    }
    limit = kind.get(step.verb, "the distance allowed")
    reach = ""
    if budget.limit_um is not None and together > 0:
        reach = f" (here {number(budget.limit_um / together)} sums away)"
    worst = max((r for r in budget.rows if r.sigma_um), key=lambda r: r.sigma_um or 0.0)
    return Caption(
        title="Error budget",
        shows=f"One standard deviation per axis of every error that {step.id} sees, "
        f"the "
        f"root of their squares, and {limit} as the dashed line.",
        judge=f"Good: the line is three sums away or more{reach}; bad: the sum comes "
        "near it.",
        do=f"Begin with the longest bar, {worst.term}: {_means(worst)}.",
    )


def _means(row: BudgetRow) -> str:
    """Return what a term comes from; of what a servo leaves, what would make it less.

    Its source is full of numbers, which are in the table of all terms.
    """
    if not row.term.endswith(LEFT_BY_SERVO):
        return row.source
    return (
        "how far off the alignment may still be when it stops, which axes that repeat "
        "better (repeatability_xy_um in the workcell) or a finer tolerance of the "
        "alignment make less"
    )


def _terms(budget: Budget) -> Element:
    """Return every term with its source."""
    rows = [
        [r.term, "not modelled" if r.sigma_um is None else um(r.sigma_um), r.source]
        for r in budget.rows
    ]
    names = (Column("term"), Column("one sigma", numeric=True), Column("from"))
    return table(names, rows)


def _allowed(step: Step) -> Element:
    """Return the largest errors of settings of the looks before the step."""
    analysis = step.budget.analysis
    found = () if analysis is None else analysis.allowed
    rows = [
        [a.error, a.look, number(a.least), number(a.most),
         "ratio" if a.unit == "1" else a.unit]
        for a in found
    ]  # fmt: skip
    names = (Column("error of"), Column("look at"), Column("least", numeric=True),
             Column("most", numeric=True), Column("unit"))  # fmt: skip
    return table(names, rows)
