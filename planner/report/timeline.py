"""The timeline of a task as a chart: when each step happens."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from microplan.schemas.files.times import StepTimes, spans
from microplan.schemas.files.world import World
from microplan.schemas.page.charts import Bar, bars
from microplan.schemas.page.elements import Element, el
from microplan.schemas.page.figures import seconds
from microplan.schemas.page.page import Caption, figure
from microplan.schemas.plan import Plan


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
