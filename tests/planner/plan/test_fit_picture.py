"""Picture of an overlap: what is dark, how much of it, and where."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.compiling.keyed import redraw
from benchmarks.compiling.outline_shapes import chain, d_shape, hollow
from microplan.optics.outline.outline import Arc, Outline
from microplan.planner.assembly.fits.peg_in_hole import PegInHole
from microplan.planner.assembly.fits.room import overlap_of
from microplan.planner.cli.main import main
from microplan.planner.plan.fit_picture import (
    MARGIN,
    OVERLAP,
    SHAFT,
    SIDE_PX,
    draw_overlap,
)
from tests.planner.examples import GRASP, between_jaws, copy_example, cut


def circle(radius: float) -> Outline:
    return chain(
        [Arc(center=(0, 0), radius_um=radius, start_rad=0, sweep_rad=math.tau)]
    )


def test_the_overlap_is_dark_and_as_large_as_it_is() -> None:
    shape = PegInHole(hole=hollow(d_shape(33.0, 20.0)), peg=circle(30.0))
    overlap = overlap_of(shape)
    assert overlap is not None
    drawn = draw_overlap(shape, overlap, "post in bore")[:SIDE_PX]
    um_per_px = 66.0 / (SIDE_PX * (1 - 2 * MARGIN))
    half = math.acos(20 / 30)
    segment = 30**2 * (half - math.sin(half) * math.cos(half))
    dark = (drawn == OVERLAP).sum() * um_per_px**2
    # lines and the label lie over some of it
    assert 0.8 * segment < dark < segment
    rows, columns = np.nonzero(drawn == OVERLAP)
    assert rows.mean() == pytest.approx(SIDE_PX / 2, abs=20)
    # lines are as dark where they are smoothed
    assert np.median(columns) > 1.2 * np.median(np.nonzero(drawn == SHAFT)[1])


def test_an_impossible_fit_is_an_infeasible_plan_with_its_picture(
    tmp_path: Path,
) -> None:
    # the bore of the issue, scaled to the gear: R 24.75, its flat 15 um out; R 22.5
    file = copy_example(tmp_path / "task")
    between_jaws(file)
    parts = file.with_name("parts")
    redraw(parts / "gear18.dxf", "BORE", d_shape(24.75, 15.0))
    redraw(parts / "shaft_plate.dxf", "POST", circle(22.5))
    insert = "{id: insert, do: insert, target: gear.bore, onto: shaft_plate.post, "
    cut(file, GRASP, insert + "move: [{stage: {z_um: 0}}]}")
    out = tmp_path / "plan"
    assert main(["compile", str(file), "-o", str(out), "--preset", "fast"]) == 1
    plan = json.loads((out / "plan.json").read_text("utf-8"))
    assert plan["status"] == "infeasible"
    codes = {reason["code"] for reason in plan["reasons"]}
    assert "MP617" in codes
    verdict = plan["steps"][1]["fit"]
    assert verdict["outline"]["overlap_um"] == pytest.approx(7.5, abs=0.01)
    assert verdict["fit"] == "interference"
    assert plan["steps"][1]["budget"]["success_probability"] == 0.0
    assert (out / "fits" / "insert.png").is_file()
