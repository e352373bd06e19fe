"""Reference images are compared by pixel, not by their files' bytes."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from microplan.planner.diff.pictures import compare_pictures
from microplan.schemas.plan import Plan, parse_plan
from tests.planner.diff.test_compare import TEXT

Pixels = npt.NDArray[np.uint8]
GREY: Pixels = np.full((12, 16), 100, dtype=np.uint8)


def one_look() -> Plan:
    """Return the golden plan's first step."""
    data = json.loads(TEXT)
    data["steps"] = data["steps"][:1]
    data["steps"][0]["looks"][0]["scene"]["image"] = "look.png"
    return parse_plan(json.dumps(data))


def folder(path: Path, pixels: Pixels | bytes | None, level: int = 3) -> Path:
    path.mkdir()
    if isinstance(pixels, bytes):
        (path / "look.png").write_bytes(pixels)
    elif pixels is not None:
        ok, data = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, level])
        assert ok
        (path / "look.png").write_bytes(data.tobytes())
    return path


def told(tmp_path: Path, old: Pixels | bytes | None, new: Pixels | bytes | None) -> str:
    """Return what is said of two pictures, "" if they are the same."""
    plan = one_look()
    ends = folder(tmp_path / "old", old), folder(tmp_path / "new", new, level=9)
    found = list(compare_pictures(plan, ends[0], plan, ends[1]))
    assert all(c.where == "steps/find_gear/looks/find_gear/scene/image" for c in found)
    return "; ".join(change.says for change in found)


def test_the_same_pixels_in_other_bytes_are_the_same(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 255, GREY.shape).astype(np.uint8)
    assert told(tmp_path, noise, noise.copy()) == ""
    files = [(tmp_path / name / "look.png").read_bytes() for name in ("old", "new")]
    assert files[0] != files[1]


def test_rounding_to_the_other_side_is_the_same(tmp_path: Path) -> None:
    assert told(tmp_path, GREY, GREY + np.uint8(1)) == ""


def test_one_pixel_is_told_with_its_place(tmp_path: Path) -> None:
    other = GREY.copy()
    other[7, 3] += 40
    says = told(tmp_path, GREY, other)
    # 40 in one of 192 pixels: rms 40 / sqrt(192)
    assert says == (
        "1 of 192 pixels differ by more than 1 of 255, at most by 40, rms 2.89; the "
        "first at row 7, column 3"
    )


def test_another_size_and_a_lost_picture_are_told(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    assert told(tmp_path / "b", GREY, GREY[:, :8]) == "16 x 12 pixels became 8 x 12"
    for name, found in (("c", None), ("d", b""), ("e", b"no picture")):
        (tmp_path / name).mkdir()
        assert told(tmp_path / name, GREY, found) == "no picture in the new folder"
    (tmp_path / "f").mkdir()
    assert told(tmp_path / "f", None, None) == ""


@pytest.mark.parametrize("name", ["/dev/zero", "../old/look.png", "a\0b.png"])
def test_a_picture_elsewhere_is_no_picture(tmp_path: Path, name: str) -> None:
    data = json.loads(TEXT)
    data["steps"] = data["steps"][:1]
    data["steps"][0]["looks"][0]["scene"]["image"] = name
    there = folder(tmp_path / "old", GREY), folder(tmp_path / "new", GREY)
    (found,) = compare_pictures(
        one_look(), there[0], parse_plan(json.dumps(data)), there[1]
    )
    assert found.says == "no picture in the new folder"


def test_a_picture_too_large_to_unpack_is_no_picture(tmp_path: Path) -> None:
    bomb = bytearray(cv2.imencode(".png", GREY)[1].tobytes())
    bomb[16:24] = (60_000).to_bytes(4, "big") * 2
    assert told(tmp_path, GREY, bytes(bomb)) == "no picture in the new folder"
