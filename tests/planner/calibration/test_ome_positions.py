"""Positions of OME-TIFF planes as readings, and what is not clear of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from microplan.planner.calibration.ome_positions import read_positions
from microplan.planner.source.diagnostics import Report


def ome(file: Path, **plane: Any) -> Path:
    """Write three pages with positions."""
    pages = np.random.default_rng(0).integers(0, 255, (3, 16, 16)).astype(np.uint8)
    metadata = {"axes": "TYX", "Plane": plane}
    tifffile.imwrite(file, pages, ome=True, metadata=metadata)
    return file


def test_positions_are_readings_in_um(tmp_path: Path) -> None:
    report = Report()
    file = ome(
        tmp_path / "a.ome.tif", PositionX=[0.0, 1.5, 3.0], PositionXUnit=["mm"] * 3
    )
    found = read_positions(file, report)
    assert found is not None
    assert not report.found
    assert found.kind == "stage"
    assert [(row.name, row.x_um) for row in found.rows] == [
        ("a.ome.tif[0]", 0.0), ("a.ome.tif[1]", 1500.0), ("a.ome.tif[2]", 3000.0),
    ]  # fmt: skip
    assert found.files == [file]


def test_planes_at_one_place_have_no_readings(tmp_path: Path) -> None:
    report = Report()
    same = {"PositionZ": [2.0] * 3, "PositionZUnit": ["um"] * 3}
    for plane in ({}, same):
        assert read_positions(ome(tmp_path / "a.ome.tif", **plane), report) is None
    (tmp_path / "none.ome.tif").write_bytes(b"II*\0 damaged")
    assert read_positions(tmp_path / "none.ome.tif", report) is None
    assert not report.found


def test_positions_that_are_not_clear_are_findings(tmp_path: Path) -> None:
    for plane, why in (
        ({"PositionX": [0.0, 1.0, 2.0]}, "is in 'reference frame', no unit of length"),
        (
            {name: value for axis in "XZ" for name, value in (
                (f"Position{axis}", [0.0, 1.0, 2.0]),
                (f"Position{axis}Unit", ["um"] * 3))},
            "stage and focus change",
        ),
    ):  # fmt: skip
        report = Report()
        assert read_positions(ome(tmp_path / "x.ome.tif", **plane), report) is None
        (found,) = report.found
        assert found.code == "MP905"
        assert why in found.message
