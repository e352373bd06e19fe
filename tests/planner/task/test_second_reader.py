"""Two readers of one file: they agree on the corpus, and say where they do not."""

from __future__ import annotations

import re
from collections.abc import Sequence

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from microplan.arrays import Point
from microplan.planner.drawings.census import Taken
from microplan.planner.drawings.dxf.drawing import Drawing, load_drawing, take
from microplan.planner.drawings.dxf.ezdxf_reading import answer_to
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.task import second_reader
from microplan.planner.task.second_reader import compare, compare_with
from tests.planner.drawings.dxf.test_corpus import EXACT, SLOT
from tests.planner.drawings.dxf_text import (
    Tags,
    box,
    circle,
    dressed,
    dxf,
    entity,
    hatch,
    insert,
    lwpolyline,
    tags_text,
)
from tests.planner.examples import EXAMPLE, read

AT = Span(file="task.yaml", line=1)

Placing = tuple[Point, Point, float, bool]
factors = st.sampled_from([-2.0, -1.0, 0.5, 1.0, 3.0])
shifts = st.floats(-50, 50)
placings = st.tuples(
    st.tuples(shifts, shifts), st.tuples(factors, factors), st.floats(0, 360),
    st.booleans(),
)  # fmt: skip


def opened(text: str | bytes, layers: Sequence[str] = ("A",)) -> tuple[Drawing, Taken]:
    """Return a drawing, and what of it is taken."""
    report = Report()
    data = text.encode() if isinstance(text, str) else text
    drawing = load_drawing(data, "part.dxf", "um", AT, AT, report)
    assert drawing is not None, report.found
    taken = take(drawing, layers, report)
    assert taken is not None, report.found
    return drawing, taken


def findings(
    drawing: Drawing, taken: Taken, other: str | bytes | None = None
) -> list[tuple[str, str]]:
    """Return severity and message of what differs from ezdxf's reading, here."""
    data = drawing.data if other is None else opened(other)[0].data
    asked = second_reader.question(drawing, [taken])
    report = Report()
    compare_with(answer_to(data, asked), drawing, [taken], report)
    assert {finding.code for finding in report.found} <= {"MP226"}
    return [(finding.severity, finding.message) for finding in report.found]


@pytest.mark.parametrize("name", EXACT)
def test_both_read_the_corpus_alike(name: str) -> None:
    text = EXACT[name][0]
    assert findings(*opened(dressed(text))) == []
    bare = {kind for kind in ("LWPOLYLINE", "SPLINE", "HATCH") if f"\n{kind}\n" in text}
    if not bare:  # these it reads with their markers alone
        assert findings(*opened(text)) == []


@given(st.lists(placings, min_size=1, max_size=3))
@settings(max_examples=30, deadline=None, phases=[Phase.generate])
def test_both_place_nested_blocks_alike(chain: list[Placing]) -> None:
    """Two ways through blocks: one matrix for all of them, or block after block."""
    blocks = [("B0", (1.0, 2.0), [box(30, 20, layer="0"), circle((9, 9), 4)])]
    for k, placing in enumerate(chain):
        blocks.append((f"B{k + 1}", (3.0, -4.0), [placed(f"B{k}", placing)]))
    text = dxf(insert(f"B{len(chain)}", (5.0, 6.0)), blocks=blocks)
    assert findings(*opened(dressed(text))) == []


def placed(name: str, placing: Placing) -> Tags:
    """Return an INSERT with its scales, angle and side."""
    (x, y), (sx, sy), angle, behind = placing
    side = [(210, 0.0), (220, 0.0), (230, -1.0 if behind else 1.0)]
    return insert(name, (x, y), (41, sx), (42, sy), (50, angle), *side)


SQUARE = box(10, 10)


@pytest.mark.parametrize(
    ("ours", "theirs", "severity", "said"),
    [
        (dxf(*[SQUARE]), dxf(SQUARE, circle((5, 5), 2)), "error",
         "ezdxf finds more than was read here: 1 CIRCLE on layer 'a'"),
        (dxf(SQUARE, circle((5, 5), 2)), dxf(SQUARE), "warning",
         "ezdxf does not find 1 CIRCLE on layer 'a'"),
        (dxf(SQUARE), dxf(box(10, 11)), "error",
         "A reaches over (0, 0) to (10, 10) um, by ezdxf over (0, 0) to (10, 11) um"),
        (dxf(SQUARE), dxf(box(10, 10, (5, 0))), "error", "5 um apart"),
        (dxf(SQUARE), dxf(SQUARE, circle((5, 5), 2, layer="B")), "", ""),
    ],
    ids=["more", "less", "larger", "moved", "other layer"],
)  # fmt: skip
def test_what_differs_is_said(ours: str, theirs: str, severity: str, said: str) -> None:
    found = findings(*opened(ours), theirs)
    assert [one for one, _ in found] == [severity] * bool(severity)
    assert all(said in message for _, message in found)


def test_sections_that_ezdxf_forgets_are_said() -> None:
    """It keeps the last of several sections of one name."""
    whole = dxf(SQUARE).replace("  0\nEOF\n", "")
    again = f"  0\nSECTION\n  2\nENTITIES\n{tags_text(circle((5, 5), 2))}  0\nENDSEC\n"
    found = findings(*opened(f"{whole}{again}  0\nEOF\n"))
    assert ("warning", "part.dxf: ezdxf does not find 4 LINE on layer 'a'") in found


def test_what_the_audit_takes_away_is_said() -> None:
    text = dressed(dxf(SQUARE))
    first, second = re.findall(r"(?m)^  5\n(\w+)$", text)[:2]
    found = findings(*opened(text.replace(f"  5\n{second}\n", f"  5\n{first}\n")))
    ((severity, message),) = found
    assert severity == "warning"
    assert "the audit of ezdxf takes away 1 LINE on layer 'a': Removed" in message


def test_what_both_leave_out_is_no_difference() -> None:
    """A hatch without boundaries: MP219 here, deleted by the audit there."""
    drawing, taken = opened(dressed(dxf(SQUARE, hatch())))
    assert taken.skipped == {("A", "HATCH without length"): 1}
    assert findings(drawing, taken) == []


def test_kinds_that_ezdxf_does_not_know_are_no_difference() -> None:
    odd: list[Tags] = [entity("ODD"), entity("WIRE", layer="0"), [(0, "PLAIN")]]
    inner: list[Tags] = [circle((5, 5), 1, layer="0"), *odd]
    blocks = [("B", (0.0, 0.0), inner)]
    report = Report()
    text = dxf(SQUARE, insert("B"), *odd[1:], blocks=blocks).encode()
    drawing = load_drawing(text, "part.dxf", "um", AT, AT, report)
    assert drawing is not None
    answer = answer_to(text, {"memory": 0, "layers": [["a"]], "fine": [1e-3]})
    assert answer["bounds"] == [(0.0, 0.0, 10.0, 10.0)]
    answer["bounds"] = []
    compare_with(answer, drawing, [], report)
    assert report.found == []


def second(text: str) -> str:
    """Return why there is no second reading, by a process of its own."""
    report = Report()
    drawing, taken = opened(text)
    compare(drawing, [taken], report)
    if not report.found:
        return ""
    (finding,) = report.found
    assert (finding.code, finding.severity, finding.where) == ("MP227", "warning", AT)
    return finding.message.removeprefix("part.dxf was not read a second time: ")


def test_a_process_of_its_own_reads_the_bytes() -> None:
    assert second(dxf(SQUARE)) == ""
    assert second(dxf(lwpolyline(SLOT))).startswith("ezdxf refuses it, DXFStructureErr")


def test_a_reading_that_takes_too_long_is_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The library's search for blocks in themselves doubles with every level."""
    blocks: list[tuple[str, Point, list[Tags]]]
    blocks = [("B0", (0, 0), []), ("B1", (0, 0), [])]
    for k in range(2, 50):
        blocks.append(
            (f"B{k}", (0, 0), [insert(f"B{k - j}", layer="X") for j in (1, 2)])
        )
    monkeypatch.setattr(second_reader, "MAX_S", 1.0)
    text = dxf(SQUARE, insert("B49", layer="X"), blocks=blocks)
    assert second(text) == "ezdxf takes more than 1 s"


def test_a_reading_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    many = dxf(SQUARE, *(entity("POINT", layer="X") for _ in range(20_000)))
    monkeypatch.setattr(second_reader, "MEMORY", 128 << 20)
    assert "MemoryError" in second(many)
    monkeypatch.setattr(second_reader, "MAX_ITEMS", 20_000)
    assert second(many).endswith("items, ezdxf is given 4194304 and 20000")


def test_the_example_is_read_alike() -> None:
    task, report = read(EXAMPLE / "task.yaml"), Report()
    second_reader.read_twice(task, report)
    assert report.found == []
    assert "ezdxf" not in second_reader.__dict__
