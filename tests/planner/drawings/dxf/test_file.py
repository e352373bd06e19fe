"""Versions and kinds of DXF files: the same drawing, whoever wrote it."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

import ezdxf
import pytest

from microplan.planner.drawings.dxf.file import read_dxf
from microplan.planner.drawings.dxf.tags import DxfError
from tests.planner.drawings.dxf.test_corpus import SLOT, SLOT_AREA, read
from tests.planner.drawings.dxf_text import binary, box, circle, dxf, insert, lwpolyline

VERSIONS = ("R12", "R2000", "R2004", "R2007", "R2010", "R2013", "R2018")


def written(folder: Path, version: str, form: str) -> bytes:
    """Return a file by ezdxf with a slot, a hole in a block, a text and a layout."""
    document: Any = ezdxf.new(version)  # type: ignore[attr-defined]
    space = document.modelspace()
    attributes = {"layer": "A"}
    if version == "R12":
        slot = space.add_polyline2d(SLOT, format="xyb", dxfattribs=attributes)
    else:
        slot = space.add_lwpolyline(SLOT, "xyb", dxfattribs=attributes)
    slot.close()
    document.blocks.new("B", base_point=(1, 0)).add_circle((1, 0), 2)
    space.add_blockref("B", (3, 0), dxfattribs=attributes)
    space.add_text("revision B", dxfattribs=attributes)
    document.layout("Layout1").add_line((0, 0), (1, 0), dxfattribs=attributes)
    document.saveas(folder / "written.dxf", fmt=form)
    return (folder / "written.dxf").read_bytes()


@pytest.mark.parametrize("form", ["asc", "bin"])
@pytest.mark.parametrize("version", VERSIONS)
def test_every_version_gives_the_same_part(
    version: str, form: str, tmp_path: Path
) -> None:
    data = written(tmp_path, version, form)
    found, report = read(data, tmp_path)
    assert found is not None, report.found
    assert found[0].area_um2 == pytest.approx(SLOT_AREA - 4 * math.pi, rel=1e-12)
    left = [d.message for d in report.found if d.code == "MP219"]
    assert left == ["part.dxf: left out: 1 LINE in paper space, 1 TEXT"]


@pytest.mark.parametrize("version", VERSIONS)
def test_no_entity_is_lost(version: str, tmp_path: Path) -> None:
    """Entities are counted against ezdxf's, in the model space and in blocks."""
    file = read_dxf(written(tmp_path, version, "asc"))
    other: Any = ezdxf.readfile(tmp_path / "written.dxf")  # type: ignore[attr-defined]
    drawn = Counter(entity.kind for entity in file.model)
    assert drawn == Counter(entity.dxftype() for entity in other.modelspace())
    inner = Counter(entity.kind for entity in file.blocks["b"].entities)
    assert inner == Counter(entity.dxftype() for entity in other.blocks.get("B"))


@pytest.mark.parametrize("short", [True, False])
def test_a_binary_file_says_what_a_text_file_says(short: bool, tmp_path: Path) -> None:
    text = dxf(
        box(100, 60),
        lwpolyline([(40, 20), (60, 20), (60, 40)]),
        insert("B", (10, 10)),
        blocks=[("B", (1, 1), [circle((3, 3), 2, layer="0")])],
    )
    data = binary(text, short=short)
    assert read(data, tmp_path)[0] == read(text, tmp_path)[0]
    for length in range(30, len(data) - 4, 7):  # cut short, it is refused
        with pytest.raises(DxfError):
            read_dxf(data[:length])


def test_line_ends_and_comments_mean_nothing(tmp_path: Path) -> None:
    text = dxf(circle((0, 0), 5))
    whole = read(text, tmp_path)[0]
    assert whole is not None
    assert read(text.replace("\n", "\r\n"), tmp_path)[0] == whole
    assert read(text.replace("\n", "\r"), tmp_path)[0] == whole
    assert read("\ufeff" + text, tmp_path)[0] == whole
    assert read("999\nby hand\n" + text, tmp_path)[0] == whole
    assert read(text + "\x1a\x00trash", tmp_path)[0] is None  # zeros are in no text
    assert read(text + "trash", tmp_path)[0] == whole
