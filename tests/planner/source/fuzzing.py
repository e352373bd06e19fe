"""Spoilt and random drawings and tasks, and what must hold of whatever is read."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from microplan.optics.outline.outline import Arc, Outline
from microplan.planner.drawings.dxf.drawing import load_drawing
from microplan.planner.drawings.gds.drawing import load_gds
from microplan.planner.source.diagnostics import TITLES, Report, Span, render_text
from microplan.planner.task.drawings import AnyDrawing, take
from microplan.planner.task.read_task import load_task
from microplan.planner.views.check_task import check_task
from tests.planner.drawings import dxf_text as dxf
from tests.planner.drawings import gds_writer as gds
from tests.planner.drawings.dxf.test_corpus import EXACT, REFUSED
from tests.planner.examples import EXAMPLE, ROOT, copy_example

DXF_TEXTS = [
    *(text for text, *_ in EXACT.values()),
    *(text for text, _ in REFUSED.values()),
    (EXAMPLE / "parts" / "gear18.dxf").read_text(encoding="ascii"),
]
GDS_FILES = [
    (ROOT / "examples" / "laser_die" / "parts" / "laser_die.gds").read_bytes(),
    gds.library(gds.cell("A", gds.boundary(gds.SQUARE), gds.text("x"), gds.node())),
    gds.library(
        gds.cell("A", gds.sref("B", (5, 5), mag=2.0, angle=30.0, mirrored=True),
                 gds.box(gds.SQUARE)),
        gds.cell("B", gds.path([(0, 0), (9000, 0), (9000, 9000)], 999, 4, ends=(5, 9))),
    ),
    gds.library(
        gds.cell("A", gds.aref("B", (0, 0), (3, 2), ((9000, 0), (0, 9000)))),
        gds.cell("B", gds.boundary(gds.ring(5000, 40)), gds.path([(0, 0), (1, 9)], 8)),
    ),
]  # fmt: skip
YAML_FILES = {
    name: (EXAMPLE / name).read_text(encoding="utf-8")
    for name in ("task.yaml", "workcell.yaml")
}
ODD_WORDS = (
    "nan", "inf", "1e308", "-1e308", "1e-308", "-1", "0", "", "A", "B", "LINE",
    "INSERT", "SEQEND", "VERTEX", "HATCH", "99999999", "0.5", "1_0", "\\U+D800",
    "*Model_Space",
    "360", "65535", "2147483648", "-0.0", "1e5000",
)  # fmt: skip
ODD_TOKENS = (
    "null", "[]", "{}", "1e400", "-1", "0x" + "f" * 400, "\"\\ud800\"", "*a", "&a 1",
    "!!str x", "'", "\"", "- ", ": ", "#", "|", ">", "? ", "{", "}", "[", "]", ",",
    "\t", "true", ".nan", "---", "...", "%YAML 9", "@", "`", "part", "gear", "tweezers",
    "~", "1e9", "1e-9", "\u2028", "\ufeff",
)  # fmt: skip
NUMBERS = st.one_of(
    st.sampled_from((0.0, -0.0, 1.0, -1.0, 0.5, 10.0, 1e-12, 1e9, 1e300, 5e-324, 1e-4)),
    st.floats(-100, 100),
    st.integers(-20, 20).map(float),
)
_AT = Span(file="task.yaml", line=1)


def dxf_outcome(data: bytes) -> tuple[Outline | None, Report]:
    """Return what a DXF file gives on layer A, and the findings."""
    report = Report()
    drawing = load_drawing(data, "part.dxf", "um", _AT, _AT, report)
    return _outline(drawing, "A", report), report


def gds_outcome(data: bytes) -> tuple[Outline | None, Report]:
    """Return what a GDSII file gives on layer 1/0, and the findings."""
    report = Report()
    drawing = load_gds(data, "part.gds", "um", None, _AT, _AT, _AT, report)
    return _outline(drawing, "1/0", report), report


def _outline(drawing: AnyDrawing | None, layer: str, report: Report) -> Outline | None:
    found = None if drawing is None else take(drawing, [layer], report)
    return None if found is None else found.outline


def judge_dxf(data: bytes) -> None:
    """Check what a DXF file gives."""
    judge(dxf_outcome(data))
    assert dxf_outcome(data) == dxf_outcome(data)


def judge_gds(data: bytes) -> None:
    """Check what a GDSII file gives."""
    judge(gds_outcome(data))
    assert gds_outcome(data) == gds_outcome(data)


def judge(found: tuple[Outline | None, Report]) -> None:
    """Check that there is either a sound outline or an error with a page."""
    outline, report = found
    assert (outline is None) == report.failed
    _judge_findings(report)
    if outline is None:
        return
    assert 0 < outline.area_um2 < math.inf
    assert all(math.isfinite(value) for value in outline.bounds_um)
    for ring in outline.rings:
        for edge in ring.edges:
            assert math.isfinite(edge.length_um)
            assert edge.length_um > 0
            assert not isinstance(edge, Arc) or abs(edge.sweep_rad) <= math.tau + 1e-9


def judge_task(name: str, text: str) -> None:
    """Check what the example gives with one of its files replaced."""
    with TemporaryDirectory() as folder:
        task = copy_example(Path(folder) / "job")
        data = text.encode("utf-8", "surrogatepass")
        task.with_name(name).write_bytes(data)
        report = Report()
        found = load_task(task, report)
        assert (found is None) == report.failed
        if found is not None:
            check_task(found, report)
        _judge_findings(report)


def _judge_findings(report: Report) -> None:
    for finding in report.in_order:
        assert finding.code in TITLES
        assert (ROOT / "docs" / "diagnostics" / f"{finding.code}.md").is_file()
        assert len(render_text(finding)) < 3000


@st.composite
def spoilt_bytes(draw: DrawFn, files: SearchStrategy[bytes]) -> bytes:
    """Return a file with stretches of bytes cut, doubled, changed or put in."""
    data = bytearray(draw(files))
    other = draw(files)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(data)))
        length = draw(st.integers(0, 40))
        start = draw(st.integers(0, len(other)))
        new = draw(
            st.one_of(
                st.binary(max_size=8),
                st.just(other[start : start + length]),
                st.just(bytes(data[at : at + length])),
                st.just(bytes(data[at : at + length]) * 2),
                st.sampled_from(
                    (b"\xff" * 8, bytes(8), b"\x7f\xff\xff\xff", b"\x80\0")
                ),
            )
        )
        data[at : at + length] = new
    end = draw(st.one_of(st.just(len(data)), st.integers(0, len(data))))
    return bytes(data[:end])


@st.composite
def spoilt_dxf(draw: DrawFn) -> bytes:
    """Return a DXF file with lines changed, and with lines of other ones in it."""
    lines = draw(st.sampled_from(DXF_TEXTS)).split("\n")
    for _ in range(draw(st.integers(1, 5))):
        at = draw(st.integers(0, max(len(lines) - 1, 0)))
        other = draw(st.sampled_from(DXF_TEXTS)).split("\n")
        start = 2 * draw(st.integers(0, len(other) // 2))
        count = draw(st.sampled_from((1, 2, 10, 40)))
        new = draw(
            st.one_of(
                st.sampled_from(ODD_WORDS).map(lambda word: [word]),
                NUMBERS.map(lambda number: [repr(number)]),
                st.just(other[start : start + count]),
                st.just(lines[at : at + count] * 2),
                st.just([]),
            )
        )
        lines[at : at + len(new[:count])] = new
    return _written("\n".join(lines), draw(st.sampled_from(("text", "R12", "R2000"))))


@st.composite
def random_dxf(draw: DrawFn) -> bytes:
    """Return a file of random entities, some in blocks, in good form."""
    names = ("B0", "B1", "B2")
    blocks = [
        (name, draw(_points()), draw(st.lists(_entities(), max_size=3)))
        for name in draw(st.lists(st.sampled_from(names), unique=True))
    ]
    inner = draw(st.lists(_entities(), min_size=1, max_size=6))
    text = dxf.dxf(*inner, blocks=blocks)
    return _written(text, draw(st.sampled_from(("text", "R12", "R2000"))))


def _written(text: str, form: str) -> bytes:
    """Return a file as text, or as binary where its numbers allow."""
    if form != "text":
        try:
            return dxf.binary(text, short=form == "R12")
        except (ValueError, struct.error):
            pass
    return text.encode("utf-8", "surrogatepass")


def _points() -> SearchStrategy[tuple[float, float]]:
    return st.tuples(NUMBERS, NUMBERS)


def _entities() -> SearchStrategy[dxf.Tags]:
    """Return entities of all kinds with random numbers."""
    points, rows = _points(), st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), max_size=6)
    plane = st.sampled_from([(), ((230, -1.0),), ((210, 1.0),), ((67, 1),), ((60, 1),)])
    placed = st.tuples(
        st.sampled_from((41, 42, 50, 44, 45, 70, 71)),
        st.one_of(NUMBERS, st.integers(-3, 4)),
    )
    return st.one_of(
        st.builds(dxf.line, points, points),
        st.builds(lambda z, r, p: dxf.circle(z, r, *p), points, NUMBERS, plane),
        st.builds(dxf.arc, points, NUMBERS, NUMBERS, NUMBERS),
        st.builds(dxf.ellipse, points, points, NUMBERS, NUMBERS, NUMBERS),
        st.builds(lambda r, f: dxf.lwpolyline(r, flags=f), rows, st.integers(0, 1)),
        st.builds(
            lambda r, w: dxf.polyline([(*row, 0) for row in r], (40, w), (41, w)),
            rows, NUMBERS,
        ),
        st.builds(lambda k, c: dxf.quad(k, c), st.sampled_from(("SOLID", "TRACE")),
                  st.lists(points, min_size=3, max_size=4)),
        st.builds(
            lambda d, z, k, w: dxf.spline(
                d, sorted(k[: len(z) + d + 1]), z, w[: len(z)]
            ),
            st.integers(0, 4), st.lists(points, max_size=8),
            st.lists(NUMBERS, min_size=13, max_size=13), st.lists(NUMBERS, max_size=8),
        ),
        st.builds(lambda n, z, t: dxf.insert(n, z, *t),
                  st.sampled_from(("B0", "B1", "B2")), points,
                  st.lists(placed, max_size=3)),
        st.builds(lambda w, h: dxf.box(w, h), NUMBERS, NUMBERS),
        st.builds(
            lambda r: dxf.hatch([(92, 3), (72, 1), (73, 1), (93, len(r)), *(
                tag for x, y, b in r for tag in (*dxf.xy(10, (x, y)), (42, b))
            )]), rows,
        ),
    )  # fmt: skip


@st.composite
def spoilt_gds(draw: DrawFn) -> bytes:
    """Return a GDSII file with records changed, and with those of other ones in it."""
    found = gds_records(draw(st.sampled_from(GDS_FILES)))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(len(found) - 1, 0)))
        other = gds_records(draw(st.sampled_from(GDS_FILES)))
        start = draw(st.integers(0, len(other)))
        count = draw(st.sampled_from((1, 2, 6)))
        old = found[at : at + 1] or [b"\0\4\4\0"]
        number = st.integers(-(2**31), 2**31 - 1).map(lambda n: struct.pack(">i", n))
        body = st.one_of(
            number, st.binary(max_size=16).map(lambda b: b + bytes(len(b) % 2)),
            st.lists(number, max_size=8).map(b"".join),
        )  # fmt: skip
        new = draw(
            st.one_of(
                body.map(lambda b, old=old: [gds.record(old[0][2], old[0][3], b)]),  # type: ignore[misc]
                st.just(other[start : start + count]),
                st.just(found[at : at + count] * 2),
                st.just([]),
            )
        )
        found[at : at + draw(st.integers(0, 2))] = new
    return b"".join(found)


def gds_records(data: bytes) -> list[bytes]:
    """Return a sound file's records."""
    found, at = [], 0
    while at + 4 <= len(data):
        length = max(struct.unpack_from(">H", data, at)[0], 4)
        found.append(data[at : at + length])
        at += length
    return found


@st.composite
def random_gds(draw: DrawFn) -> bytes:
    """Return a library of random shapes and placements, in good form."""
    number = st.one_of(st.integers(-20, 20).map(lambda n: n * 500),
                       st.integers(-(2**31), 2**31 - 1))  # fmt: skip
    points = st.lists(st.tuples(number, number), min_size=1, max_size=9)
    name = st.sampled_from(("A", "B", "C"))
    at = st.tuples(number, number)
    turns = st.sampled_from((0.0, 90.0, -90.0, 30.0, 0.001, 45.0, 3601.0, -1e-9, 123.4))
    mags = st.sampled_from((1.0, 2.0, 1e-3, 1e3, 1e7, 0.1, -1.0))
    small = st.integers(-1, 4)
    shapes = st.one_of(
        st.builds(gds.boundary, points),
        st.builds(gds.box, points),
        st.builds(gds.path, points, number, st.integers(0, 5)),
        st.builds(lambda n, z, m, t, f: gds.sref(n, z, mag=m, angle=t, mirrored=f),
                  name, at, mags, turns, st.booleans()),
        st.builds(lambda n, z, c, r, a, b, t: gds.aref(n, z, (c, r), (a, b), angle=t),
                  name, st.just((0, 0)), small, small,
                  st.tuples(small, small), st.tuples(small, small), turns),
    )  # fmt: skip
    cells = [
        gds.cell(name, *draw(st.lists(shapes, min_size=1, max_size=5)))
        for name in ("A", "B", "C")[: draw(st.integers(1, 3))]
    ]
    units = draw(st.sampled_from((gds.NM, (1e-3, 1e-6), (1.0, 1e-6), (1e-3, 1e-30))))
    return gds.library(*cells, units=units)


@st.composite
def spoilt_yaml(draw: DrawFn) -> tuple[str, str]:
    """Return the name of one of the example's files, and a spoilt text for it."""
    name = draw(st.sampled_from(sorted(YAML_FILES)))
    text = YAML_FILES[name]
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(text)))
        ways = st.sampled_from(("word", "cut", "line", "insert", "double"))
        way = draw(ways)
        odd = draw(st.one_of(st.sampled_from(ODD_TOKENS), st.text(max_size=5)))
        end = next((k for k in range(at, len(text)) if text[k] in " ,}]\n"), len(text))
        start = text.rfind("\n", 0, at) + 1
        stop = text.find("\n", at) + 1 or len(text)
        if way == "word":
            text = text[:at] + odd + text[end:]
        elif way == "cut":
            text = text[:at] + text[at + draw(st.integers(0, 30)) :]
        elif way == "line":
            text = text[:start] + text[stop:]
        elif way == "insert":
            text = text[:at] + odd + text[at:]
        else:
            text = text[:stop] + text[start:stop] + text[stop:]
    return name, text
