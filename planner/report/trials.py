"""Results of a look's trials: robustness, accuracy, cost, rejected chains."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from microplan.planner.report.margins import need_um
from microplan.schemas.files.evidence import LookEvidence, TrialRecord
from microplan.schemas.page.axes import ChartField, around_log
from microplan.schemas.page.charts import ChartPoint, legend, scatter
from microplan.schemas.page.elements import Element, el
from microplan.schemas.page.figures import number, signed, um
from microplan.schemas.page.page import Caption, Column, figure, more, table
from microplan.schemas.plan import FallbackRecord, Look, Measure, Score

_FOCUS_CELLS, _ZOOM_CELLS = 5, 3
_ROOM = 1.5  # factor of the error axis beyond its largest and least value


@dataclass(frozen=True, slots=True)
class _Bin:
    """An interval of one drift."""

    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Return whether a value lies in it."""
        return self.low <= value < self.high


def robustness(look: Look, evidence: LookEvidence | None) -> Iterator[Element]:
    """Yield the map of focus and zoom: trials right of trials made, and the worst."""
    if evidence is None or not evidence.trials:
        return
    trials, tolerance = evidence.trials, look.evidence.tolerance_um
    columns = _bins([t.focus_um for t in trials], 0.0, _FOCUS_CELLS)
    rows = _bins([t.magnification for t in trials], 1.0, _ZOOM_CELLS)[::-1]
    head = [el("th", _between(b), scope="col") for b in columns]
    body = [
        el(
            "tr",
            el("th", _between(_Bin(100 * (row.low - 1), 100 * (row.high - 1))),
               scope="row"),
            [_cell(_inside(trials, column, row), tolerance) for column in columns],
        )
        for row in rows
    ]  # fmt: skip
    content = el(
        "table",
        el(
            "caption",
            "error of the focus across, \u00b5m; of the magnification down, %",
        ),
        el("thead", el("tr", el("td"), head)),
        el("tbody", body),
        class_="map",
    )
    low, high = look.measure.usable_focus_um
    small, large = look.measure.usable_magnification
    caption = Caption(
        title="Robustness over focus and magnification",
        shows="In each cell how many of how many trials "
        f"{chain_of(look.measure)} measured within two tolerances, and "
        f"below that the largest error; {len(trials)} "
        "trials in all, with light, pose and noise disturbed as well.",
        judge=f"Good, green: all of all, with errors below the tolerance of "
        f"{um(tolerance)}; amber: all of all, with an error beyond it; bad, red: "
        "fewer than all, above all where an answer was wrong without a word.",
        do=f"Stay within {signed(low)} to {signed(high)} \u00b5m of focus at nominal "
        f"zoom "
        f"and {number(small, 4)} to {number(large, 4)} of the magnification at nominal "
        f"focus: there {_draws(look.measure)} met the tolerance.",
    )
    yield figure(caption, el("div", content, class_="wide"))


def _draws(measure: Measure) -> str:
    """Return how many images a usable range comes from."""
    count = measure.usable_draws
    return "every draw" if count is None else f"all of {count} draws"


def accuracy(look: Look) -> Iterator[Element]:
    """Yield accuracy against time of all routines, with front and choice."""
    scores = [look.evidence.chosen, *look.evidence.others]
    known = [(s, need) for s in scores if (need := need_um(s))]
    if not known:
        return
    tolerance = look.evidence.tolerance_um
    axes = ChartField(
        across=around_log([s.cost for s, _ in known]),
        up=around_log([*(need for _, need in known), tolerance], room=_ROOM),
        across_label="time, box filters of a 640 \u00d7 480 frame",
        up_label="2 sigma + |bias|, \u00b5m",
    )
    front = _front([(s.cost, need) for s, need in known if s.success == s.trials])
    chosen = look.evidence.chosen
    best = need_um(chosen)
    points = [_point(s, need, chosen, front) for s, need in known]
    drawing = scatter(
        f"Accuracy against time of {len(known)} chains of routines for {look.target}",
        f"Chosen: {_named(chosen)} with {um(best)} at cost {number(chosen.cost)}; the "
        f"tolerance is {um(tolerance)}.",
        axes,
        points,
        front=front,
        chosen=None if best is None else (chosen.cost, best),
        limit=tolerance,
        limit_name=f"tolerance {um(tolerance)}",
    )
    limit = look.measure.limit_xy_um
    beside = (
        ""
        if limit is None
        else (f"; the physical limit of a place, one sigma, is {um(limit)}")
    )
    caption = Caption(
        title="Accuracy against time of all routines",
        shows="Every chain tried: dots answered rightly in all their trials, crosses "
        "did "
        f"not; the line joins those that none is both quicker and better than{beside}"
        + _stopped(scores, chosen)
        + _failed(look)
        + ".",
        judge="Good: the circled choice lies well below the tolerance and far to the "
        "left; bad: only crosses lie below it.",
        do="If the choice is close to the tolerance, look at a higher magnification or "
        "let the step's tolerance grow; the table of what was rejected says why.",
    )
    yield figure(caption, drawing, legend(points))


def rejected(look: Look) -> Iterator[Element]:
    """Yield what was tried and not chosen, and why: chains, features, zooms."""
    others = look.evidence.others
    if others:
        columns = (
            Column("routines"), Column("right", numeric=True),
            Column("silently wrong", numeric=True),
            Column("2 sigma + |bias|", numeric=True), Column("worst", numeric=True),
            Column("time", numeric=True), Column("why"),
        )  # fmt: skip
        rows = [_score_row(score) for score in (look.evidence.chosen, *others)]
        yield more(f"What was tried: {len(rows)} chains of routines",
                   table(columns, rows))  # fmt: skip
    features = look.evidence.features
    if features:
        rows = [[f.name, f.kind, " > ".join(f.chain) or "\u2013", f.reason]
                for f in features]  # fmt: skip
        names = ("feature", "kind", "best routines", "used or not, and why")
        yield more(f"Features of the part: {len(rows)}",
                   table([Column(n) for n in names], rows))  # fmt: skip
    if look.verdict is not None and look.verdict.zoom.refused:
        rows = [[f"{number(z.magnification)} \u00d7", z.reason]
                for z in look.verdict.zoom.refused]  # fmt: skip
        yield more(f"Magnifications refused: {len(rows)}",
                   table([Column("magnification"), Column("why")], rows))  # fmt: skip


def _score_row(score: Score) -> list[str]:
    """Return the cells of one chain."""
    return [
        _named(score), f"{score.success} of {score.trials}", str(score.silent),
        um(need_um(score)), um(score.worst_um), number(score.cost), score.reason,
    ]  # fmt: skip


def chain_of(measure: Measure) -> str:
    """Return the routines that measure a feature, coarse to fine."""
    return " > ".join(use.id for use in measure.chain)


def _named(score: Score) -> str:
    return " > ".join(score.chain)


def _point(
    score: Score, need: float, chosen: Score, front: Sequence[tuple[float, float]]
) -> ChartPoint:
    """Return a chain as a point; the choice and the front are numbered."""
    sure = score.success == score.trials
    on_front = sure and (score.cost, need) in front
    words = f"{_named(score)}: {um(need)}, cost {number(score.cost)}; {score.reason}"
    return ChartPoint(
        x=score.cost,
        y=need,
        label=words,
        kind="dot" if sure else "cross",
        named=_named(score) if score is chosen or on_front else "",
    )


def _stopped(scores: Sequence[Score], chosen: Score) -> str:
    """Return what to say of chains that had fewer trials than the choice, if any."""
    passing = [s.trials for s in scores if not s.reason.startswith("rejected")]
    fewer = [trials for trials in passing if trials < chosen.trials]
    if not fewer:
        return ""
    return (
        f"; chains that cost more than the choice may have stopped after {min(fewer)} "
        f"of its {chosen.trials} trials: their errors are known less well"
    )


def _failed(look: Look) -> str:
    """Return how a choice that did not answer rightly in all its trials can do."""
    chosen = look.evidence.chosen
    missing = chosen.trials - chosen.success - chosen.silent
    said = ""
    if missing > 0:
        spare = " > ".join(use.id for use in look.measure.fallback)
        then = f"measures with {spare} instead, or " if spare else ""
        said += (
            f"; the choice gave no answer in {missing} of its {chosen.trials} trials: "
            f"a run then {then}looks again, which P(success) counts as time lost, not "
            "as a failure"
        )
    said += _together(look.evidence.fallback)
    if chosen.silent > 0:
        said += (
            f"; in {chosen.silent} of its {chosen.trials} trials the choice answered "
            "wrongly: the score below which answers are refused is set against such, "
            "and what passes it all the same is not in P(success)"
        )
    return said


def _together(found: FallbackRecord | None) -> str:
    """Return how often the choice and its fallback fail on the same image."""
    if found is None:
        return ""
    if found.lack:
        return f"; {found.lack}"
    return (
        f"; the choice goes by {found.principle}, its fallback by "
        f"{found.other_principle}: both failed in {found.both_failed} of "
        f"{found.trials} trials, a rate below {100 * found.both_failed_upper:.2g} % "
        "at 95 %"
    )


def _front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points that no other is both cheaper and better than."""
    found: list[tuple[float, float]] = []
    for point in sorted(points):
        if not found or point[1] < found[-1][1]:
            found.append(point)
    return found


def _bins(values: Sequence[float], middle: float, count: int) -> list[_Bin]:
    """Return equal intervals about the middle that hold all values."""
    half = max((abs(v - middle) for v in values), default=0.0)
    if half <= 0:
        return [_Bin(-math.inf, math.inf)]
    edges = [middle + half * (2 * k / count - 1) for k in range(count + 1)]
    edges[-1] = math.nextafter(edges[-1] + 1e-12 * half, math.inf)
    edges[0] -= 1e-12 * half
    return [_Bin(low, high) for low, high in pairwise(edges)]


def _inside(
    trials: Sequence[TrialRecord], focus: _Bin, zoom: _Bin
) -> list[TrialRecord]:
    return [
        t for t in trials if focus.holds(t.focus_um) and zoom.holds(t.magnification)
    ]


def _between(interval: _Bin) -> str:
    """Return an interval as its ends."""
    if math.isinf(interval.low):
        return "0"
    low, high = (number(round(v, 9), 2) for v in (interval.low, interval.high))
    return f"{low} \u2026 {high}"


def _cell(trials: Sequence[TrialRecord], tolerance_um: float) -> Element:
    """Return one cell: how many were right, and the largest error."""
    if not trials:
        return el("td", "no trial", class_="none")
    right = [t for t in trials if t.error_um is not None and not t.wrong]
    worst = max((t.error_um for t in trials if t.error_um is not None), default=None)
    if len(right) < len(trials):
        kind = "bad"
    else:
        kind = "good" if worst is not None and worst <= tolerance_um else "fair"
    said = f"{len(right)} of {len(trials)}"
    return el("td", said, el("small", "no answer" if worst is None else um(worst, 2)),
              class_=kind)  # fmt: skip
