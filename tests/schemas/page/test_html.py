"""Elements, numbers and charts of pages: nothing from a file becomes markup."""

from __future__ import annotations

import html
import math
import re
from html.parser import HTMLParser
from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.schemas.page.axes import AxisScale, ChartField, around, around_log
from microplan.schemas.page.charts import Bar, ChartPoint, bars, curve, legend, scatter
from microplan.schemas.page.elements import el, slug, write
from microplan.schemas.page.figures import chance, number, seconds, um
from microplan.schemas.page.labels import LabelBox, width
from microplan.schemas.page.page import document, png_size, png_uri

# what markup, addresses and terminals obey, and what they do not
LETTERS = "<>&\"'/;:=#(){}ab \u00e9\u202e\x00\ud800\n"
TEXT = st.text(st.sampled_from(LETTERS), max_size=20)
VALUES = st.floats(-1e6, 1e6)


class Heard(HTMLParser):
    """What a reader of the markup hears: elements, attributes and text."""

    def __init__(self, markup: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text = ""
        self.feed(markup)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        self.text += data


@given(text=TEXT, value=TEXT)
def test_no_text_becomes_markup(text: str, value: str) -> None:
    heard = Heard(write(el("p", text, title=value)))
    assert heard.tags == ["p"]
    assert [name for name, _ in heard.attributes] == ["title"]
    plain = "".join(c for c in text if c.isprintable() or c == "\t")
    assert all(c in heard.text for c in plain)


@given(names=st.lists(TEXT, min_size=2, max_size=2, unique=True))
def test_other_names_have_other_ids(names: list[str]) -> None:
    one, two = map(slug, names)
    assert one != two
    assert not set(one) - set(
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-"
    )


@pytest.mark.parametrize(
    ("name", "attributes"),
    [
        ("script", {}),
        ("iframe", {}),
        ("p", {"onclick": "x"}),
        ("a", {"href": "https://example.org"}),
        ("a", {"href": "javascript:x"}),
        ("img", {"src": "data:text/html;base64,AAAA"}),
        ("img", {"src": "picture.png"}),
    ],
)
def test_what_could_run_or_fetch_is_refused(
    name: str, attributes: dict[str, str]
) -> None:
    with pytest.raises(ValueError, match="page"):
        el(name, **attributes)


def test_a_style_fetches_nothing() -> None:
    assert "url(" not in write(el("p", style="background:url(http://x)"))
    with pytest.raises(ValueError, match="style"):
        write(el("style", "p{}</style><p>"))
    assert "//" not in document("a page", el("p", "text"))


def test_what_turns_text_round_is_spelled_out() -> None:
    assert "\u202e" not in write(el("p", "a\u202eb", title="\x00"))
    assert "\\u202e" in write(el("p", "a\u202eb"))
    for hidden in "\u061c\u200b\u2028\u2060\ufeff\U000e0041":
        assert f"\\u{ord(hidden):04x}" in write(el("p", f"gear{hidden}"))
    assert write(el("p", "1\u202f\u00b5m \u05d2")) == "<p>1\u202f\u00b5m \u05d2</p>"


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "0"), (1234.5, "1234"), (12.345, "12.3"), (0.012345, "0.0123"),
        (-0.5, "\u22120.5"), (1.2e-5, "1.2\u00d710\u207b\u2075"), (100.0, "100"),
        (None, "\u2013"), (math.inf, "any"), (-0.0, "0"),
    ],
)  # fmt: skip
def test_numbers_have_three_digits(value: float | None, said: str) -> None:
    assert number(value) == said


@given(value=st.floats(1e-3, 1e5))
def test_a_number_is_told_to_half_a_percent(value: float) -> None:
    assert float(number(value)) == pytest.approx(value, rel=0.0051)


def test_small_lengths_are_told_in_nm() -> None:
    assert um(0.0342) == "34\u202fnm"
    assert um(2.9) == "2.9\u202f\u00b5m"


@pytest.mark.parametrize(
    ("value", "said"),
    [(1 / 30, "33\u202fms"), (0.9446, "0.94\u202fs"), (13.15, "13.2\u202fs"),
     (0.0, "0\u202fs"), (1.933, "1.93\u202fs"), (None, "\u2013")],
)  # fmt: skip
def test_short_times_are_told_in_ms(value: float | None, said: str) -> None:
    assert seconds(value) == said


def test_almost_certain_is_not_certain() -> None:
    assert chance(1.0) == "> 0.9999"  # of six digits that were rounded
    assert chance(0.99994) == "0.9999"
    assert chance(1 - 1e-9) == "> 0.9999"
    assert chance(1e-9) == "< 0.0001"
    assert chance(0.99359) == "0.9936"


@given(values=st.lists(VALUES, min_size=1, max_size=6))
def test_ticks_lie_on_their_scale(values: list[float]) -> None:
    sized = [abs(v) + 1e-3 for v in values]
    for scale in (around(values), around(values, zero=True), around_log(sized)):
        ticks = scale.ticks()
        assert ticks
        assert all(-1e-9 <= scale.share(tick) <= 1 + 1e-9 for tick in ticks)
        assert len(ticks) <= 16


@given(
    xs=st.lists(VALUES, min_size=2, max_size=6),
    y=st.floats(1e-6, 1e6),
    name=TEXT,
)
def test_charts_hold_finite_numbers_alone(xs: list[float], y: float, name: str) -> None:
    axes = ChartField(
        across=around(xs), up=around_log([y]), across_label=name, up_label=name
    )
    points = [ChartPoint(x=x, y=y, label=name, named=name) for x in xs]
    drawn = [
        curve(name, name, axes, [(x, y) for x in xs], here=xs[0], limit=y),
        scatter(name, name, axes, points, front=[(x, y) for x in xs]),
        bars(name, name, [Bar(label=name, pieces=((y, ""),), said=name)], limit=y),
    ]
    for each in drawn:
        heard = Heard(write(each))
        kept = " ".join(
            v or "" for k, v in heard.attributes if k not in ("aria-label",)
        )
        assert "nan" not in kept
        assert "inf" not in kept
        assert heard.tags[:3] == ["svg", "title", "desc"]


def test_a_scale_rises() -> None:
    with pytest.raises(ValueError, match="rises"):
        AxisScale(low=1.0, high=1.0)
    with pytest.raises(ValueError, match="logarithm"):
        AxisScale(low=0.0, high=1.0, log=True)


def test_only_pictures_are_taken_into_a_page() -> None:
    with pytest.raises(ValueError, match="picture"):
        png_uri(b"<svg onload=x>")
    with pytest.raises(ValueError, match="PNG"):
        png_size(b"\x89PNG\r\n\x1a\n")


@pytest.mark.parametrize(
    ("points", "left", "below"),
    [
        ([(0.0, 0.5), (4.0, 0.5)], False, False),  # far below the line
        ([(0.0, 0.5), (3.5, 1.1), (4.0, 0.5)], True, False),  # over it at the right
        ([(0.0, 1.1), (4.0, 1.1)], False, True),  # over all of it
    ],
)
def test_no_curve_crosses_the_name_of_its_limit(
    points: list[tuple[float, float]], left: bool, below: bool
) -> None:
    axes = ChartField(
        across=AxisScale(low=0.0, high=4.0),
        up=AxisScale(low=0.0, high=2.0),
        across_label="look",
        up_label="error",
    )
    drawn = write(curve("c", "c", axes, points, limit=1.0, limit_name="tolerance"))
    (words,) = re.findall(
        r'<text x="([\d.]+)" y="([\d.]+)" class="(limit[^"]*)">', drawn
    )
    assert (words[2] == "limit") == left
    assert (float(words[1]) > axes.y(1.0)) == below


def _boxes(drawn: str) -> list[LabelBox]:
    """Return the places of a chart's words."""
    found = []
    for x, y, kind, said in re.findall(
        r'<text x="([\d.-]+)" y="([\d.-]+)"(?: class="([^"]*)")?>([^<]*)', drawn
    ):
        wide = width(html.unescape(said), 10.5 if "tick" in kind else 11.0)
        left = float(x) - (wide if "end" in kind else wide / 2 if "mid" in kind else 0)
        base = float(y)
        found.append(
            LabelBox(left=left, top=base - 8, right=left + wide, bottom=base + 2)
        )
    return found


def test_numbers_of_crowded_points_are_apart_and_in_the_picture() -> None:
    axes = ChartField(
        across=AxisScale(low=1.0, high=200.0, log=True),
        up=AxisScale(low=0.1, high=10.0, log=True),
        across_label="time",
        up_label="error",
    )
    names = ("otsu", "otsu > tooth_notch", "otsu > circle_caliper", "contour_match")
    points = [
        ChartPoint(x=20.0 + k, y=1.0, label=name, named=name)
        for k, name in enumerate(names)
    ]
    points.append(
        ChartPoint(x=190.0, y=1.0, label="far", named="otsu > tooth_notch > ecc")
    )
    drawn = write(
        scatter("s", "s", axes, points, front=[(p.x, p.y) for p in points],
                chosen=(20.0, 1.0), limit=1.5, limit_name="tolerance 3 um")
    )  # fmt: skip
    boxes = _boxes(drawn)
    assert re.findall('class="number mid">([^<]*)', drawn) == ["1", "2", "3", "4", "5"]
    assert re.findall("<li>([^<]*)", write(legend(points))) == [
        html.escape(p.named, quote=False) for p in points
    ]
    assert not any(a.meets(b) for a, b in combinations(boxes, 2))
    assert all(box.left >= 0 and box.right <= 360 for box in boxes)


@given(
    said=st.text("abcmW 0123.", min_size=1, max_size=12),
    label=st.text("abcmW_>", min_size=1, max_size=60),
    limit=st.floats(0.02, 2.0),
)
def test_no_line_of_bars_runs_through_words(
    said: str, label: str, limit: float
) -> None:
    rows = [Bar(label=label, pieces=((1.0, ""),), said=said)] * 3
    drawn = write(bars("b", "b", rows, limit=limit, limit_name="limit", unit="um"))
    words = [b.grown(1.0) for b in _boxes(drawn)]
    lines = re.findall(
        r'<line x1="([\d.]+)" x2="[\d.]+" y1="([\d.]+)" y2="([\d.]+)"', drawn
    )
    assert lines
    above = [box for box in words if box.bottom < 3 * 31]  # of the ticks
    assert len(above) == 2 * len(rows)  # labels and sizes
    for x, top, bottom in lines:
        line = ((float(x), float(top)), (float(x), float(bottom)))
        assert not any(box.crossed(line) for box in above)
