"""What pictures tell, as one page of HTML in the manner of a camera's data sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    CalibrationCurve,
    CalibrationSeries,
)
from microplan.planner.store.folder import replace_alike
from microplan.schemas.page.axes import WIDTH, ChartField, around
from microplan.schemas.page.elements import Element, Node, el, slug
from microplan.schemas.page.figures import number
from microplan.schemas.page.page import (
    Caption,
    Column,
    Row,
    chart,
    document,
    figure,
    link,
    more,
    table,
)

_FOOT = (
    "One file, no scripts, nothing fetched. A spread is one standard deviation, by the "
    "jackknife over what errs independently, of a stage's noise by the count of its "
    "stops; a pull is found less stated over it."
)
_MOST_NOTES = 8  # in sight
_FAR = 3.0  # standard deviations: stated and found disagree
_WIDE_HEAD = ("value", "found", "standard deviation", "stated", "pull", "how")


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveWords:
    """What a chart shows."""

    across: str
    up: str
    shows: str
    judge: str
    do: str


_RESIDUALS = {
    "shows": "How far the part lay from where readings have it, stop by stop; a "
    "distortion that was found is taken off.",
    "judge": "Points without a trend are the stage's noise; a trend is a stage that is "
    "not straight, or a lens that distorts otherwise.",
    "do": "Look at a stop far off all others: was the part moved?",
}
_WORDS: Mapping[str, CurveWords] = {
    "photon transfer": CurveWords(
        across="level / counts",
        up="variance in time / counts^2",
        shows="Variance of counts in time over their level; the line is that of "
        "photons and read noise.",
        judge="Points on a rising line are photons; a bend or a fall is a response in "
        "the camera, and the table holds it all the same.",
        do="If points at either end fall, expose so that no count is cut off.",
    ),
    "response": CurveWords(
        across="light reading, of the largest",
        up="median level / counts",
        shows="Level of the median pixel over the light's reading; the line is the "
        "response that was found.",
        judge="All points below saturation lie on the line; one off it is a reading or "
        "a lamp that erred.",
        do="Take a light off the line again, with its reading.",
    ),
    "residuals x": CurveWords(
        across="stage reading x / um",
        up="to the right of the fit / 0.001 px",
        **_RESIDUALS,
    ),
    "residuals y": CurveWords(
        across="stage reading y / um", up="above the fit / 0.001 px", **_RESIDUALS
    ),
}
_EDGE = CurveWords(
    across="distance outwards from the edge / px",
    up="light, of full scale",
    shows="Mean light across the part's edges; the line is the compiler's image at the "
    "aperture and focus that were found.",
    judge="Where the line leaves the points, the lens has errors that images lack.",
    do="State what is left as the workcell's discrepancy.",
)


def calibration_page(workcell: str, series: Sequence[CalibrationSeries]) -> str:
    """Return the page of all series; the same series give the same bytes."""
    toc = [el("li", link(each.heading, slug(each.heading))) for each in series]
    main = el(
        "main",
        el("section", el("h2", "Found against stated"), _verdict(series),
           _table([v for each in series for v in each.values]),
           id="verdict"),
        el("nav", el("h2", "Series"), el("ul", toc, class_="contents"),
           aria_label="Series"),
        [_section(each) for each in series],
        id="main",
    )  # fmt: skip
    return document(
        f"{workcell} \u2013 microplan calibration",
        el(
            "header",
            el("p", "microplan calibration from pictures", class_="kicker"),
            el("h1", workcell),
        ),
        main,
        el("footer", el("p", _FOOT)),
    )


def write_calibration_page(
    file: Path, workcell: str, series: Sequence[CalibrationSeries]
) -> None:
    """Write the page; MP702 if it cannot be, MP703 if another file is there."""
    data = calibration_page(workcell, series).encode()
    replace_alike(file, data, head=data.index(b"<title>"))


def _verdict(series: Sequence[CalibrationSeries]) -> Element:
    """Return how many stated values the pictures contradict."""
    values = [value for each in series for value in each.values]
    stated = [value for value in values if value.stated is not None]
    far = [value.key for value in stated if abs(value.pull or 0.0) > _FAR]
    words = f"{len(values)} values from {len(series)} series; of {len(stated)} that "
    words += f"the workcell states, {len(far)} are more than {_FAR:g} standard "
    words += "deviations off" + (f": {', '.join(far)}." if far else ".")
    return el("p", words)


def _table(values: Sequence[CalibratedValue]) -> Element:
    """Return values with what was stated, a row each."""
    columns = [Column(name, name in _WIDE_HEAD[1:5]) for name in _WIDE_HEAD]
    return table(columns, [_row(value) for value in values], label="Values")


def _row(value: CalibratedValue) -> Row:
    unit = "" if value.unit == "1" else f" / {value.unit}"
    if not isinstance(value.value, float):
        rows = f"{len(value.value)} rows"
        return [value.key + unit, rows, "by row", number(None), number(None),
                value.method]  # fmt: skip
    (sigma,) = value.sigma
    pull = value.pull
    shown: Node = number(pull, 2)
    if pull is not None and abs(pull) > _FAR:
        shown = el("strong", number(pull, 2))
    found = number(value.value, _digits(value.value, sigma))
    return [value.key + unit, found, number(sigma, 2), number(value.stated, 5), shown,
            value.method]  # fmt: skip


def _digits(value: float, sigma: float | None) -> int:
    """Return significant digits down to the second of the standard deviation."""
    if not sigma or not value:
        return 5
    digits = 3
    while digits < 9 and abs(value) * 10.0 ** (1 - digits) > sigma:
        digits += 1
    return digits


def _section(series: CalibrationSeries) -> Element:
    """Return what one series tells."""
    said = el("ul", [el("li", note) for note in series.notes])
    many = len(series.notes) > _MOST_NOTES
    charts = [_figure(name, curve) for name, curve in series.curves.items()]
    return el(
        "section",
        el("h2", series.heading),
        el("div", charts, class_="cols"),
        more("In words", said) if many else said,
        id=slug(series.heading),
    )


def _figure(name: str, curve: CalibrationCurve) -> Element:
    """Return a chart of points and the line through them, with its caption."""
    words = _WORDS.get(name, _EDGE)
    every = [*curve.points, *curve.line]
    axes = ChartField(
        across=around([x for x, _ in every]),
        up=around([y for _, y in every], zero=True),
        across_label=words.across,
        up_label=words.up,
    )
    drawn: list[Element] = [*axes.draw()]
    if curve.line:
        path = " ".join(f"{axes.x(x):.1f},{axes.y(y):.1f}" for x, y in curve.line)
        drawn.append(el("polyline", points=path, class_="curve"))
    drawn += [
        el("circle", cx=axes.x(x), cy=axes.y(y), r=2.6, class_="dot")
        for x, y in curve.points
    ]
    title = name[0].upper() + name[1:]
    caption = Caption(title=title, shows=words.shows, judge=words.judge, do=words.do)
    shape = chart(title, words.shows, drawn, width=WIDTH, height=axes.height)
    return figure(caption, shape)
