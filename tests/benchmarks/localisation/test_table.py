"""Where the table of all routines starts each, and that its page shows all."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.localisation.rows import FEWEST, Row, affordable, begin
from benchmarks.localisation.scenes import PLACE_UM, SCENES, Drawn, disturbed
from benchmarks.localisation.table import lines, measure_all
from benchmarks.localisation.trials import prepared
from microplan.featuresel.look.sensitivity import LookSetting
from microplan.featuresel.routines.registry import REGISTRY, load

PAGE = Path(__file__).parents[3] / "docs" / "localisation.md"


@pytest.mark.parametrize("scene", list(SCENES))
def test_a_routine_starts_within_its_capture_range(scene: str) -> None:
    case = disturbed(SCENES[scene](), "all")
    rng = np.random.default_rng(5)
    for name in sorted(REGISTRY):
        routine = load(name)
        if case.target.kind not in routine.kinds:
            continue
        dx, dy = rng.uniform(-PLACE_UM, PLACE_UM, 2)
        setting = LookSetting(dx_um=dx, dy_um=dy, dtheta_rad=0.01, dz_um=4.0, zoom=1.03)
        drawn = Drawn(setting=setting, image=np.zeros((1, 1)))
        at = begin(case, name, drawn, rng)
        x, y = (1.03 * (a + b) for a, b in ((case.x_um, dx), (case.y_um, dy)))
        column, row = case.frame.to_pixel(x, y)
        off = math.hypot(at.column - column, at.row - row)
        reach = min(routine.capture_px, 1.5 * case.target.search_px)
        assert off <= reach, name
        known = {"theta": at.theta_rad, "z": at.z_um, "zoom": at.zoom}
        assert all(known[need] is not None for need in routine.requires if need != "xy")


def test_a_row_is_a_line_of_the_table() -> None:
    row = Row(
        scene="gear", routine="ncc", condition="all", trials=400, right=300, silent=4,
        ratio_x=(1.04, 12.4, 123.4, math.nan), ratio_theta=(math.nan,) * 4, ms=2.51,
        refused="", codes=("no_edge", "diverged", "no_edge"),
    )  # fmt: skip
    head, rule, line = list(lines("gear", [row], 100))[-3:]
    assert head.count("|") == rule.count("|") == line.count("|")
    cells = [cell.strip() for cell in line.split("|")[1:-1]]
    assert cells == [
        "`ncc`", "all", "1", "12", "123", "", "", "", "", "",
        "100", "75%", "1%", "no_edge", "2.5",
    ]  # fmt: skip


def test_a_table_of_the_page_shows_every_routine_for_its_scene() -> None:
    tables = PAGE.read_text(encoding="utf-8").split("\n### ")[1:]
    assert tables
    for table in tables:
        kind = SCENES[table.partition(",")[0]]().target.kind
        wanted = sorted(n for n in REGISTRY if kind in load(n).kinds)
        shown = [li.split("`")[1] for li in table.splitlines() if li.startswith("| `")]
        assert shown[::2] == shown[1::2] == wanted  # plain and all


def test_the_page_shows_every_routine() -> None:
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    shown = {line.split("`")[1] for line in lines if line.startswith("| `")}
    assert set(REGISTRY) <= shown


@pytest.mark.slow
def test_errors_at_an_edge_are_those_across_it(tmp_path: Path) -> None:
    wanted = [("edge", "plain", ("line_caliper",))]
    limit, row = measure_all(wanted, 3, 1, tmp_path / "record.jsonl")
    assert row.right > 0 == row.silent  # along it answers are up to 3 um off
    assert all(0 < nm < 10 for nm in limit.ratio_x)
    assert "across 0" in next(
        line for line in lines("edge", [row], 3) if "ms |" in line
    )


@pytest.mark.slow
def test_rows_that_are_recorded_are_not_measured_again(tmp_path: Path) -> None:
    path = tmp_path / "record.jsonl"
    first = list(measure_all([("shaft", "plain", ("otsu",))], 2, 1, path))
    assert [row.routine for row in first] == ["limit", "otsu"]
    known = path.read_text(encoding="utf-8")
    again = list(measure_all([("shaft", "plain", ("otsu",))], 2, 1, path))
    assert again[1] == replace(first[1], ratio_theta=again[1].ratio_theta)
    assert all(math.isnan(v) for v in again[1].ratio_theta)  # never equal itself
    assert path.read_text(encoding="utf-8") == known
    more = list(measure_all([("shaft", "plain", ("hough", "otsu"))], 2, 1, path))
    assert [row.routine for row in more] == ["limit", "otsu", "hough"]
    assert path.read_text(encoding="utf-8").startswith(known)


def test_a_slow_routine_gets_fewer_trials() -> None:
    case = disturbed(SCENES["shaft"](), "plain")
    shown = Drawn(setting=LookSetting(), image=np.zeros((480, 640)))
    ready = {n: dict(prepared(case, (n,)))[n] for n in ("likelihood", "otsu")}
    slow, fast = (affordable(n, a, shown, 10**6) for n, a in ready.items())
    assert FEWEST <= slow < fast
    assert all(affordable(n, a, shown, 5) == 5 for n, a in ready.items())
