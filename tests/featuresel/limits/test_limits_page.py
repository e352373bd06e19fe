"""The table of docs/limits.md against its benchmark, which makes all of the page."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from benchmarks.localisation.limits import HEIGHTS, row

PAGE = Path(__file__).parents[3] / "docs" / "limits.md"


def table() -> dict[float, list[float]]:
    """Return the numbers of the gear's table by focus; inf where it is blind."""
    lines = PAGE.read_text("utf-8").splitlines()
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
    gears = [cells for cells in rows if len(cells) == 7 and cells[0][:1] in "0.1234567"]
    return {
        float(cells[0]): [
            math.inf if cell == "blind" else float(cell.removesuffix(" %"))
            for cell in cells[1:]
        ]
        for cells in gears
        if cells[0]
    }


def test_every_focus_of_the_benchmark_is_in_the_table() -> None:
    assert tuple(table()) == HEIGHTS


@pytest.mark.parametrize("z_um", [0.0, 10.0])
def test_table_is_what_the_benchmark_finds(z_um: float) -> None:
    # two digits are printed, of .00075 too
    assert table()[z_um] == pytest.approx(row(z_um), rel=0.01)
