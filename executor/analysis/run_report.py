"""Report of a run: predicted against actual, servo curves, focus curves, frames."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from microplan.executor.analysis.run_frames import frame_figures, pair, predicted, times
from microplan.executor.analysis.run_summaries import (
    Row,
    RunArtifacts,
    read_left,
    real,
    reals,
    text,
)
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.record.outcome import injected
from microplan.executor.record.run_folder import REPORT
from microplan.executor.record.write_ahead_log import ESCAPED
from microplan.schemas.page.axes import AxisScale, ChartField, around
from microplan.schemas.page.charts import Bar, bars, curve
from microplan.schemas.page.elements import Element, Node, el, slug
from microplan.schemas.page.figures import MICRO, chance, number, quantity, seconds, um
from microplan.schemas.page.page import (
    Caption,
    Column,
    document,
    facts,
    figure,
    link,
    table,
)

_FOOT = "One file, no scripts, nothing fetched. SHA-256 of the plan: "
_SECTIONS = (
    ("Verdict", "verdict"), ("Predicted against actual", "compared"),
    ("Servo", "servo"), ("Heights by focus", "focus"), ("Frames", "frames"),
)  # fmt: skip
_DASH = (
    "A dash: there is nothing of the kind in the step. Looks are counted in alignments "
    "alone, limits are set for alignments and verifications, and what is not looked at "
    "has no look error. Times are predicted with every target seen at the first look."
)
_UM = f"{MICRO}m"
_MOST_RATIO = 1e6  # of a bar; a longer one would show no more


def write_report(folder: Path) -> Path:
    """Write the report of a run into its folder, and return where it is.

    Raises
    ------
    ExecutorError
        MP879 if the folder holds no run, MP863 if the report cannot be written.
    """
    text_ = run_report(read_left(folder))
    file = folder / REPORT
    try:
        fresh = folder / f"{REPORT}.new"
        fresh.write_text(text_, encoding="utf-8", errors=ESCAPED, newline="\n")
        fresh.replace(file)
    except OSError as error:
        raise ExecutorError("MP863", f"{file}: {error}") from error
    return file


def run_report(left: RunArtifacts) -> str:
    """Return the report of a run; the same folder gives the same bytes."""
    name = text(left.summary, "plan") or text(left.plan, "name") or "run"
    toc = [el("li", link(words, place)) for words, place in _SECTIONS]
    return document(
        f"{name} \u2013 microplan run",
        el("header", el("p", "microplan report of a run", class_="kicker"),
           el("h1", name)),
        el(
            "main",
            _first(left),
            el("nav", el("h2", "Contents"), el("ul", toc, class_="contents"),
               aria_label="Contents"),
            _section("Predicted against actual", "compared", _compared(left),
                     "The run ended before any step did."),
            _section("Servo", "servo", _servo(left), "No step was servoed."),
            _section("Heights by focus", "focus", _focus(left),
                     "No height was looked for."),
            _section("Frames", "frames", frame_figures(left), "No frames were kept."),
            id="main",
        ),
        el("footer", el("p", _FOOT, el("span", left.plan_sha256, class_="hash"), ".")),
    )  # fmt: skip


def _section(
    title: str, place: str, content: Iterator[Element], nothing: str
) -> Element:
    """Return a section, with a sentence where there is nothing to show."""
    found = list(content)
    return el("section", el("h2", title), found or el("p", nothing), id=place)


def _first(left: RunArtifacts) -> Element:
    """Return the verdict and the run's figures."""
    data = left.summary
    station = text(data, "station") or "not told"
    simulated = station == "sim"
    seed, planned = data.get("seed"), left.plan.get("steps")
    done = sum(not step.get("code") for step in left.steps)
    low = real(data, "success_low")
    least = None if low is None else el("small", f"at least {chance(low)}")
    pairs: list[tuple[str, Node]] = [
        ("steps done", f"{done} of {len(planned) if isinstance(planned, list) else 0}"),
        ("time", [seconds(real(data, "time_s")), predicted(left)]),
        ("P(success) predicted", [chance(real(data, "success_probability")), least]),
        ("station", "simulated cell" if simulated else station),
    ]  # fmt: skip
    if simulated and isinstance(seed, int):
        pairs.append(("seed", str(seed)))
    if faults := _faults(data):
        pairs.append(("injected faults", faults))
    truth = data.get("cell_verdict")
    return el(
        "section", _verdict(left), _truth(truth) if isinstance(truth, dict) else None,
        facts(pairs), id="verdict", class_="first",
    )  # fmt: skip


def _faults(data: Row) -> str:
    """Return the faults that were asked for, "" if none were."""
    asked, idle = data.get("faults"), data.get("idle_faults")
    return injected(
        [str(fault) for fault in asked] if isinstance(asked, list) else [],
        idle if isinstance(idle, list) else None,
    )


def _verdict(left: RunArtifacts) -> Element:
    """Return how the run ended."""
    data = left.summary
    word, kind = "Failed", "verdict bad"
    if not data:
        word = "Not ended"
        said = ": the run was stopped or killed before its summary was written."
    elif not data.get("code"):
        word, kind = "Done", "verdict good"
        said = ": every step and its own verification passed."
    else:
        step = text(data, "step")
        where = f" in {step}" if step else ""
        said = f"{where}: {text(data, 'code')}, {text(data, 'message')}"
    return el("p", el("span", word, class_=kind), said, class_="lead")


def _truth(verdict: Row) -> Element:
    """Return the simulated cell's own verdict on the part."""
    good = verdict.get("success") is True
    words = "seated" if good else "not seated"
    offset = um(real(verdict, "offset_um"))
    return el("p", "The simulated cell's own verdict, which no plan sees: ",
              el("strong", words, class_="good" if good else "bad"),
              f", {offset} off.")  # fmt: skip


def _compared(left: RunArtifacts) -> Iterator[Element]:
    """Yield predicted against actual as a table and as charts."""
    steps = left.steps
    if not steps:
        return
    true = left.summary.get("true_look_error_um")
    known: Row = true if isinstance(true, dict) else {}
    looks = "look error" if known else "own estimate"
    columns = (
        Column("step"), Column("result"), Column("looks / expected", numeric=True),
        Column(f"error / limit, {_UM}", numeric=True),
        Column(f"{looks} / sigma, {_UM}", numeric=True),
        Column("time / expected", numeric=True),
    )  # fmt: skip
    rows = [_row(left, step, known) for step in steps]
    ids = [slug("step", str(step["id"])) for step in steps]
    yield table(columns, rows, ids=ids, label="Predicted against actual")
    yield el("p", _DASH, class_="note")
    found = [*_shares(steps), *_sigmas(steps, known)]
    if found:
        yield el("div", found, class_="cols")


def _row(left: RunArtifacts, step: Row, known: Row) -> list[Node]:
    """Return the cells of one step."""
    code, name = text(step, "code"), str(step["id"])
    result = el("span", code or "done", class_="bad" if code else "good")
    return [
        name,
        [result, f" {text(step, 'message')}" if code else None],
        pair(number(real(step, "cycles")), number(real(step, "expected_cycles"))),
        pair(number(real(step, "error_um")), number(real(step, "limit_um"))),
        pair(number(_looked(step, known)), number(real(step, "expected_sigma_um"))),
        times(left, step),
    ]  # fmt: skip


def _shares(steps: Sequence[Row]) -> Iterator[Element]:
    """Yield the errors that steps ended with, as shares of their limits."""
    caption = Caption(
        title="Errors left, over their limits",
        shows="The error that each alignment and verification measured last, as a "
        "share of what the plan allows.",
        judge="Good: bars well left of the dashed line; bad: they come close to it "
        "run after run.",
        do="Compare several runs with microplan-run --mode compare before you "
        "change anything.",
    )
    found = ((str(s["id"]), real(s, "error_um"), real(s, "limit_um")) for s in steps)
    if rows := _ratios(found):
        drawing = bars("Errors over their limits", _said(rows), rows, limit=1.0,
                       limit_name="limit", unit="of the limit")  # fmt: skip
        yield figure(caption, drawing)


def _said(rows: Sequence[Bar]) -> str:
    """Return bars in words."""
    return "; ".join(f"{row.label} {row.said}" for row in rows)


def _ratios(found: Iterable[tuple[str, float | None, float | None]]) -> list[Bar]:
    """Return a bar for every (label, value, scale) of finite ratio."""
    return [
        Bar(label=label, pieces=((min(value / scale, _MOST_RATIO), ""),),
            said=f"{number(value)} of {quantity(scale, _UM)}")
        for label, value, scale in found
        if value is not None and scale and math.isfinite(value / scale)
    ]  # fmt: skip


def _sigmas(steps: Sequence[Row], known: Row) -> Iterator[Element]:
    """Yield the looks' errors over the sigma that the plan gives them."""
    what = "true error" if known else "own estimate of its spread"
    caption = Caption(
        title="Looks against what the plan promised",
        shows=f"Each step's last look, its {what} over the sigma per axis in the plan.",
        judge="Good: nineteen of twenty bars end before the dashed line, at 2.45 "
        "sigma; bad: many cross it.",
        do="If looks are worse than promised, compare focus, light and lens with "
        "the workcell file.",
    )
    found = (
        (str(s["id"]), _looked(s, known), real(s, "expected_sigma_um")) for s in steps
    )
    if rows := _ratios(found):
        drawing = bars("Looks against their sigma", _said(rows), rows, limit=2.45,
                       limit_name="95 %", unit="in sigma")  # fmt: skip
        yield figure(caption, drawing)


def _looked(step: Row, known: Row) -> float | None:
    """Return a look's true error where those are known, else its own estimate, um."""
    return real(known, str(step["id"])) if known else real(step, "spread_um")


def _servo(left: RunArtifacts) -> Iterator[Element]:
    """Yield the error over the looks of every alignment."""
    found = []
    for step in dict.fromkeys(text(row, "step") for row in left.of("error")):
        errors = [
            e for row in left.of("error", step)
            if (e := real(row, "error_um")) is not None
        ]  # fmt: skip
        limit = next((real(s, "limit_um") for s in left.steps if s["id"] == step), None)
        if errors:
            found.append(_servo_figure(step, errors, limit))
    if found:
        yield el("div", found, class_="cols")


def _servo_figure(step: str, errors: list[float], limit: float | None) -> Element:
    """Return the error over the looks of one alignment."""
    top = max([*errors, limit or 0.0]) * 1.15 or 1.0
    looks = "1 look" if len(errors) == 1 else f"{len(errors)} looks"
    axes = ChartField(
        across=AxisScale(low=0.0, high=max(len(errors), 3) + 0.5),
        up=AxisScale(low=0.0, high=top),
        across_label="look",
        up_label=f"error, {_UM}",
        height=196,
    )
    points = [(float(k), e) for k, e in enumerate(errors, 1)]
    drawing = curve(
        f"Error over the looks of {step}",
        ", ".join(um(e) for e in errors),
        axes,
        points,
        limit=limit,
        limit_name=f"tolerance {um(limit)}",
    )
    caption = Caption(
        title=f"Servo of {step}: {looks}",
        shows="The measured distance to the goal after the approach and after each "
        "correction.",
        judge="Good: it falls below the dashed tolerance within a few looks; bad: it "
        "swings or creeps.",
        do="If it swings, lower `servo.gain` of workcell.yaml or check the stage's "
        "settling time; where the tolerance is near the axes' repeatability, further "
        "looks are chance: allow a wider one, or use finer axes.",
    )
    return figure(caption, drawing)


def _focus(left: RunArtifacts) -> Iterator[Element]:
    """Yield sharpness over focus of every height that was looked for."""
    heights = {text(row, "step"): real(row, "z_um") for row in left.of("height")}
    found = []
    for row in left.of("focus_curve"):
        data = row.get("curve")
        seen: Row = data if isinstance(data, dict) else {}
        pairs = list(zip(reals(seen, "focus_um"), reals(seen, "scores"), strict=False))
        if len(pairs) > 1:
            step = text(row, "step")
            found.append(_focus_figure(step, pairs, heights.get(step)))
    if found:
        yield el("div", found, class_="cols")


def _focus_figure(
    step: str, pairs: list[tuple[float, float]], height: float | None
) -> Element:
    """Return sharpness over focus of one sweep."""
    axes = ChartField(
        across=around([x for x, _ in pairs]),
        up=around([y for _, y in pairs], zero=True),
        across_label=f"focus, {_UM}",
        up_label="sharpness",
        height=196,
    )
    said = "no height was found" if height is None else f"height {um(height)}"
    drawing = curve(f"Sharpness over focus in {step}", said, axes, pairs, here=height)
    caption = Caption(
        title=f"Focus sweep of {step}: {said}",
        shows="The sharpness of the face at every stop of the sweep; the upright "
        "line is the height that was taken.",
        judge="Good: one clear peak with the line on it; bad: a flat curve, two "
        "peaks or one at the end.",
        do="If the peak is at an end, the face is not where the plan has it: check "
        "what it lies on.",
    )
    return figure(caption, drawing)
