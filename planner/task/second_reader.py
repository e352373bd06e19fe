"""Second reading of DXF drawings, by ezdxf: where the two differ is reported."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from microplan.planner.drawings.biarcs import CURVE_UM
from microplan.planner.drawings.census import Taken
from microplan.planner.drawings.drawing_findings import (
    MAX_LISTED,
    UM_PER_UNIT,
    extent_um,
)
from microplan.planner.drawings.dxf.census import reached
from microplan.planner.drawings.dxf.drawing import Drawing
from microplan.planner.drawings.dxf.entities import READERS
from microplan.planner.drawings.rings import GAP_UM
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.task.drawings import DrawingSheet
from microplan.planner.task.task import Task

if TYPE_CHECKING:  # it loads ezdxf, which has a process of its own
    from microplan.planner.drawings.dxf.ezdxf_reading import EzdxfAnswer, Question, Row

MAX_BYTES = 4 << 20
MAX_ITEMS = 50_000  # a few seconds; planner.second_reader_most_s measures them
MAX_S = 60.0  # ten times what the largest take, on a machine that is not busy
MEMORY = 1 << 30  # bytes, addresses without content included
FINE = 1e-4  # of the extent: by what ezdxf_reading may fall short in a curve

_CHILD = """import sys
sys.path[:] = {path!r}
from microplan.planner.drawings.dxf.ezdxf_reading import main
main()
"""

Tally = Counter[tuple[str, str, str]]  # by block, layer and kind


class NoAnswerError(Exception):
    """Why there is no second reading."""


def read_twice(task: Task, report: Report, memo: Memo = EVERY_TIME) -> None:
    """Let ezdxf read the DXF drawings of a task, and report where it differs.

    What it finds beyond what was read here, and other extents, are errors: one of the
    readings is wrong. What it lacks, or its audit takes away, is a warning.
    """
    sheets = [part.sheet for part in task.parts.values()]
    sheets += [tool.sheet for tool in task.workcell.tools.values()]
    for drawing, takes in _by_file(sheets):
        compare(drawing, takes, report, memo)


def compare(
    drawing: Drawing, takes: Sequence[Taken], report: Report, memo: Memo = EVERY_TIME
) -> None:
    """Report what ezdxf's reading of a drawing differs in, or why there is none."""
    try:
        _check_size(drawing)
        asked = json.dumps(question(drawing, takes))
        answer: EzdxfAnswer = json.loads(memo.call(ask, asked, drawing.data))
    except NoAnswerError as error:
        message = f"{drawing.file} was not read a second time: {error}"
        hint = "what it holds rests on one reader"
        report.warning("MP227", drawing.at, message, hint)
        return
    compare_with(answer, drawing, takes, report)


def compare_with(
    answer: EzdxfAnswer, drawing: Drawing, takes: Sequence[Taken], report: Report
) -> None:
    """Report what ezdxf's reading differs in."""
    layers = frozenset(name.lower() for taken in takes for name in taken.layers)
    ours = _tally(drawing)
    before, after = (_like(ours, answer[key]) for key in ("before", "after"))
    at, file = drawing.at, drawing.file
    if more := _mattering(before - ours, layers):
        message = f"{file}: ezdxf finds more than was read here: {_said(more)}"
        hint = "save it again from the CAD program, as DXF R2000 or later"
        report.error("MP226", at, message, hint)
    if less := _mattering(ours - before, layers):
        message = f"{file}: ezdxf does not find {_said(less)}"
        report.warning("MP226", at, message, "look whether it belongs to the part")
    if lost := _mattering(before - after, layers) - _left_out(takes):
        message = f"{file}: the audit of ezdxf takes away {_said(lost)}"
        kinds = {kind for _, kind in lost}
        why = [fix for fix in answer["fixes"] if any(f" {k}(" in fix for k in kinds)]
        message = ": ".join([message, *why[:1]])
        report.warning("MP226", at, message, "look whether it belongs to the part")
    _compare_extents(drawing, takes, answer, report)


def question(drawing: Drawing, takes: Sequence[Taken]) -> Question:
    """Return what ezdxf is asked about a drawing."""
    um = UM_PER_UNIT[drawing.units]
    return {
        "memory": MEMORY,
        "layers": [[name.lower() for name in taken.layers] for taken in takes],
        "fine": [FINE * extent_um(taken.outline) / um for taken in takes],
    }


def _compare_extents(
    drawing: Drawing, takes: Sequence[Taken], answer: EzdxfAnswer, report: Report
) -> None:
    """Report outlines that ezdxf draws elsewhere, or of another size."""
    um = UM_PER_UNIT[drawing.units]
    for taken, found in zip(takes, answer["bounds"], strict=True):
        if not taken.plain or found is None:
            continue  # strokes have a border, hatches no lines; too many to walk
        ours = taken.outline.bounds_um
        theirs = tuple(value * um for value in found)
        within = FINE * extent_um(taken.outline) + CURVE_UM + GAP_UM
        off = max(abs(a - b) for a, b in zip(ours, theirs, strict=True))
        if off <= within:
            continue
        message = (
            f"{drawing.file}: {', '.join(taken.layers)} reaches over {_box(ours)} um, "
            f"by ezdxf over {_box(theirs)} um; {off:.3g} um apart, allowed {within:.3g}"
        )
        hint = "explode its blocks, or save it again from the CAD program"
        report.error("MP226", taken.at, message, hint)


def _by_file(sheets: Sequence[DrawingSheet]) -> Iterator[tuple[Drawing, list[Taken]]]:
    """Yield every DXF file once for a unit, with all that was taken from it."""
    found: dict[tuple[bytes, str], tuple[Drawing, list[Taken]]] = {}
    for sheet in sheets:
        if isinstance(drawing := sheet.drawing, Drawing):
            key = drawing.data, drawing.units
            found.setdefault(key, (drawing, []))[1].extend(sheet.takes)
    yield from found.values()


def _check_size(drawing: Drawing) -> None:
    """Raise NoAnswerError for a drawing that would take ezdxf too long."""
    items = drawing.document.items
    if len(drawing.data) > MAX_BYTES or items > MAX_ITEMS:
        size = f"{len(drawing.data)} bytes and {items} items"
        raise NoAnswerError(
            f"it has {size}, ezdxf is given {MAX_BYTES} and {MAX_ITEMS}"
        )


def ask(question_: str, data: bytes) -> str:
    """Return what ezdxf finds in a file, as JSON.

    Raises
    ------
    NoAnswerError
        If it refuses the file, takes too long or too much memory.
    """
    try:
        done = subprocess.run(  # noqa: S603 - this interpreter, a constant program
            [sys.executable, "-c", _CHILD.format(path=sys.path)],
            input=question_.encode() + b"\n" + data,
            capture_output=True,
            timeout=MAX_S,
            check=False,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
    except subprocess.TimeoutExpired as error:
        raise NoAnswerError(f"ezdxf takes more than {MAX_S:g} s") from error
    if done.returncode:
        raise NoAnswerError(f"ezdxf ended with status {done.returncode}")
    answer = done.stdout.decode()
    refused = json.loads(answer).get("error")
    if refused is not None:
        raise NoAnswerError(f"ezdxf refuses it, {refused}")
    return answer


def _tally(drawing: Drawing) -> Tally:
    """Return what was read here: the model space and the blocks that it reaches."""
    file = drawing.document
    tally: Tally = Counter()
    for name in reached(file):
        for entity in file.blocks[name].entities if name else file.model:
            tally[name, entity.layer.lower(), entity.kind] += 1
    for name in reached(file):
        tally[name, "", ""] = 0  # though it be empty
    return tally


def _like(ours: Tally, rows: Sequence[Row]) -> Tally:
    """Return ezdxf's counts of the blocks that `ours` has."""
    blocks = {block for block, _, _ in ours}
    return Counter(
        {(block, layer, kind): n for block, layer, kind, n in rows if block in blocks}
    )


def _mattering(tally: Tally, layers: frozenset[str]) -> Counter[tuple[str, str]]:
    """Return what can be part of an outline on `layers`, by layer and kind.

    In a block, layer "0" means that of the INSERT.
    """
    found: Counter[tuple[str, str]] = Counter()
    for (block, layer, kind), n in tally.items():
        drawn = kind in READERS and (layer in layers or (block and layer == "0"))
        if drawn or kind == "INSERT":
            found[layer, kind] += n
    return found


def _left_out(takes: Sequence[Taken]) -> Counter[tuple[str, str]]:
    """Return what was left out here, too, since it has no length."""
    found: Counter[tuple[str, str]] = Counter()
    for taken in takes:
        for (layer, what), n in taken.skipped.items():
            if what.endswith(" without length"):
                found[layer.lower(), what.partition(" ")[0]] += n
    return found


def _said(counts: Counter[tuple[str, str]]) -> str:
    """Return kinds and layers with their numbers, the first few."""
    said = [f"{n} {kind} on layer '{layer}'" for (layer, kind), n in counts.items()]
    more = len(said) - MAX_LISTED
    return ", ".join(sorted(said)[:MAX_LISTED]) + (
        f" and {more} more" if more > 0 else ""
    )


def _box(bounds: Sequence[float]) -> str:
    x0, y0, x1, y1 = bounds
    return f"({x0:.6g}, {y0:.6g}) to ({x1:.6g}, {y1:.6g})"
