"""The numbers of docs/limits.md, computed anew."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from featuresel.case import LookCase
from featuresel.crlb import camera_of, fisher, informative
from featuresel.information import limit
from featuresel.nuisances import prices
from featuresel.resolution import contrast, limit_curve, spurious_um
from featuresel.sensitivity import LIGHT, POSE, Sensitivities, Setting, sensitivities

Look = Callable[[str], LookCase]

PAGE = Path(__file__).parents[2] / "docs" / "limits.md"
UNKNOWN = (*POSE, "gain", "offset")
HEIGHTS = (0.0, 0.3, 10.0, 25.0, 50.0)


@pytest.fixture(scope="module")
def seen() -> dict[float, Sensitivities]:
    return {}


def gear(look: Look) -> LookCase:
    """Return the gear of the page, a fraction of a pixel off the grid."""
    case = look("find_gear")
    scope = replace(case.microscope, pitch_um=7.4)
    return replace(case, microscope=scope, x_um=0.31, y_um=-0.17)


def at(
    look: Look, seen: dict[float, Sensitivities], z_um: float
) -> tuple[Sensitivities, LookCase]:
    """Return the gear's slopes at a focus; computed once a module."""
    case = gear(look)
    if z_um not in seen:
        seen[z_um] = sensitivities(case, Setting(dz_um=z_um), POSE + LIGHT)
    return seen[z_um], case


def table() -> dict[float, list[str]]:
    """Return the cells of the page's table of the gear by focus."""
    rows = [line.split("|")[1:-1] for line in PAGE.read_text("utf-8").splitlines()]
    gears = [
        row for row in rows if len(row) == 7 and row[0].strip()[0] in ".0123456789"
    ]
    return {float(row[0]): [cell.strip() for cell in row[1:]] for row in gears}


@pytest.mark.parametrize("z_um", HEIGHTS)
def test_table_of_the_gear(
    look: Look, seen: dict[float, Sensitivities], z_um: float
) -> None:
    slopes, case = at(look, seen, z_um)
    camera = camera_of(case)
    sigma = limit(fisher(slopes.only(UNKNOWN), camera))
    chosen = informative(
        slopes.only(("x", "y", "theta", "gain")), camera, POSE[:3], share=0.95
    )
    found = [
        sigma["x"] * case.microscope.px_per_um,
        sigma["x"] * 1e3,
        math.degrees(sigma["theta"]) * 1e3,
        sigma["z"] * 1e3,
        sigma["zoom"] * 1e5,
        100 * chosen.mean(),
    ]
    cells = [cell.removesuffix(" %") for cell in table()[z_um]]
    stated = [math.inf if cell == "blind" else float(cell) for cell in cells]
    # two digits are printed, of .00075 too
    assert stated == pytest.approx(found, rel=0.01)


def test_pair_and_prices(look: Look, seen: dict[float, Sensitivities]) -> None:
    text = " ".join(PAGE.read_text("utf-8").split())
    slopes, case = at(look, seen, 10.0)
    camera = camera_of(case)
    other = sensitivities(case, Setting(dz_um=-10.0), POSE + LIGHT)
    both = fisher(slopes, camera).without(LIGHT) + fisher(other, camera).without(LIGHT)
    assert f"tell z to {1e3 * limit(both)['z']:.1f} nm" in text
    far, _ = at(look, seen, 25.0)
    cost = prices(fisher(far, camera), POSE[:4], free=("zoom", "gain"), extra=LIGHT[1:])
    percent = [f"{100 * (cost[name] - 1):.1f} %" for name in LIGHT[1:]]
    assert (
        f"{percent[0]} for a gradient along x, {percent[1]} along y, {percent[2]} for"
        in text
    )


def test_numbers_out_of_focus(look: Look) -> None:
    text = " ".join(PAGE.read_text("utf-8").split())
    case = gear(look)
    ends = [spurious_um(replace(case, model=law)) for law in ("exact", "hopkins")]
    assert "{:.1f} um for the gear above with `exact`, {:.1f} um".format(*ends) in text
    teeth, circle = (contrast(look(n), (5.0, 10.0)) for n in ("find_gear", "post"))
    stated = [f"{value:.2f}".lstrip("0") for value in (*teeth, *circle)]
    assert (
        "{} at 5 um and {} at 10, for a circle of 22 um {} and {}.".format(*stated)
        in text
    )


def test_depth_of_field_of_the_gear(look: Look) -> None:
    text = " ".join(PAGE.read_text("utf-8").split())
    assert "4 nm in x over +-39 um and to 10 mdeg in theta over +-17 um" in text
    case = gear(look)
    for name, z_um, tolerance in (
        ("x", 39.0, 4e-3),
        ("theta", 17.0, math.radians(0.01)),
    ):
        curve = limit_curve(case, name, ("x", "y", "theta", "gain"))
        assert curve(z_um) <= tolerance < curve(z_um + 1)
