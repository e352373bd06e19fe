"""A lens that the workcell states, from the task to looks of the simulated cell.

The judge is the cell's own camera of solid bodies, which shares no optics with trials.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

import microplan.executor.cli.main
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.perturb import image
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.trials import measure_picture, prepare
from microplan.optics.transfer.microscope import Terms
from microplan.planner.assembly.step_states import unfold
from microplan.planner.cli.main import main
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.presets import PRESETS
from microplan.planner.views.requests import requests
from microplan.planner.views.target_views import views
from tests.planner.examples import FEW, ONE_LOOK, change, copy_example, cut, read

TERMS: Terms = ((5, 0.05), (8, 0.1))  # astigmatism, coma
HALO = (3.0, 0.03)  # um, share
SEEDS = range(3)
WRONG = (-0.5, -0.17, 0.17, 0.5)  # of a pixel: what thresholds err by averages out

# All that displaces or changes a picture besides the lens' stated errors is none.
CELL = (
    ("parcentric_sigma_um: 1.0", "parcentric_sigma_um: 0"),
    ("scale_sigma: 0.002", "scale_sigma: 0"),
    ("lateral_sigma_um_per_um: 0.002", "lateral_sigma_um_per_um: 0"),
    ("distortion_sigma: 0.001", "distortion_sigma: 0"),
    ("light: {kind", "discrepancy: {edge: 0, flat: 0, pixel: 0}\nlight: {kind"),
    (
        "coherence: incoh",
        "wavefront: ["
        + ", ".join(f"{{noll: {noll}, waves: {waves}}}" for noll, waves in TERMS)
        + f"]\n  halo: {{radius_um: {HALO[0]}, share: {HALO[1]}}}\n  coherence: incoh",
    ),
)


def one_look_through_the_lens(folder: Path) -> Path:
    """Return the example's task file, cut down to one look through that lens."""
    file = copy_example(folder)
    cut(file, ONE_LOOK)
    change(file, "max_image_error: 0.002", "max_image_error: 0.06")
    change(file, "sigma_xy_um: 10", "sigma_xy_um: 2")
    for old, new in CELL:
        change(file.with_name("workcell.yaml"), old, new)
    return file


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What runs of the look said, (N, 2) um, and how far off each truly was, um."""

    places_um: np.ndarray
    errors_um: tuple[float, ...]


def runs(plan: Path, folder: Path) -> Seen:
    """Return the looks of runs on the cell that lies in the plan's folder."""
    places, errors = [], []
    for seed in SEEDS:
        there = folder / str(seed)
        cell = ("--station", "sim", "--camera", "solid", "--seed", str(seed))
        call = [str(plan / "plan.json"), *cell, "--run-dir", str(there), "--no-frames"]
        assert microplan.executor.cli.main.main(call) == 0
        events = map(json.loads, (there / "events.jsonl").read_text().splitlines())
        (at,) = (event["at"] for event in events if event["event"] == "seen")
        places.append((at["x_um"], at["y_um"]))
        summary = json.loads((there / "summary.json").read_text())
        errors.append(summary["true_look_error_um"]["see_post"])
    return Seen(places_um=np.array(places), errors_um=tuple(errors))


def through_another(plan: Path, folder: Path, terms: Terms) -> Path:
    """Return a copy of a plan's folder whose cell has a lens with other terms."""
    shutil.copytree(plan, folder)
    file = folder / "world.json"
    world = json.loads(file.read_text())
    assert world["optics"]["wavefront"] == [list(term) for term in TERMS]
    assert (world["optics"]["halo_radius_um"], world["optics"]["halo_share"]) == HALO
    world["optics"]["wavefront"] = [list(term) for term in terms]
    file.write_text(json.dumps(world))
    return folder


def opposite(terms: Terms) -> Terms:
    return tuple((noll, -waves) for noll, waves in terms)


@dataclass(frozen=True, slots=True, kw_only=True)
class Looked:
    """One look compiled, and run through the stated lens and through its opposite."""

    task: Path
    measure: Mapping[str, Any]
    right: Seen
    wrong: Seen


@pytest.fixture(scope="module")
def looked(tmp_path_factory: pytest.TempPathFactory) -> Looked:
    folder = tmp_path_factory.mktemp("lens")
    file, plan = one_look_through_the_lens(folder / "task"), folder / "plan"
    words = ("--preset", "fast", "--no-cache", "--jobs", "1")
    with patch.dict(PRESETS, {"fast": FEW}):
        assert main(["compile", str(file), "-o", str(plan), *words]) == 0
    (step,) = json.loads((plan / "plan.json").read_text())["steps"]
    other = through_another(plan, folder / "other", opposite(TERMS))
    return Looked(
        task=file,
        measure=step["looks"][-1]["measure"],
        right=runs(plan, folder / "right"),
        wrong=runs(other, folder / "wrong"),
    )


def sigmas(errors_um: Sequence[float], sigma_um: float) -> float:
    """Return the rms of errors over both axes, in those of one axis."""
    return math.hypot(*errors_um) / math.sqrt(2 * len(errors_um)) / sigma_um


def test_looks_through_the_stated_lens_err_as_promised(looked: Looked) -> None:
    """An rms above 2 sigma has a chance below 1e-3 in 3 runs."""
    sigma_um = looked.measure["sigma_xy_um"]
    assert sigmas(looked.right.errors_um, sigma_um) < 2
    assert max(looked.right.errors_um) < 3 * math.sqrt(2) * sigma_um


def look_case(file: Path) -> LookCase:
    """Return the look at its first view, as it was compiled."""
    task, report = read(file), Report()
    (asked,) = requests(task, unfold(task, report), 0, None)
    low, _ = task.workcell.optics.magnification
    view, *_ = views(task, asked, low, report)
    case, _ = build_case(task, asked, view, task.optimise.image_error("fast"))
    return case


def answers_um(case: LookCase, chain: tuple[str, ...], terms: Terms) -> np.ndarray:
    """Return the mean answer, (x, y) um, in images through a lens with some terms.

    Prepared for the stated one, over places in a pixel.
    """
    seen = replace(case, microscope=replace(case.microscope, wavefront=terms))
    ready, side, found = prepare(case, (chain,)), case.microscope.um_per_px, []
    for x in WRONG:
        for y in WRONG:
            trial = Trial(index=0, dx_um=x * side, dy_um=y * side, dtheta_rad=0.0,
                          model="exact", seed=(0,))  # fmt: skip
            (outcome,) = measure_picture(case, ready, trial, image(seen, trial))
            assert outcome.world_um is not None
            found.append(outcome.world_um)
    return np.asarray(np.mean(found, axis=0))


def test_a_lens_of_the_other_sign_moves_looks_as_images_say(looked: Looked) -> None:
    """By .25 um: more than any promise, and as far as trials through it would be."""
    sigma_um = looked.measure["sigma_xy_um"]
    moved = np.mean(looked.wrong.places_um - looked.right.places_um, axis=0)
    case, chain = look_case(looked.task), looked.measure["chain"]
    assert case.microscope.wavefront == TERMS
    names = tuple(use["id"] for use in chain)
    there, here = (answers_um(case, names, t) for t in (opposite(TERMS), TERMS))
    wanted = there - here
    # both are means over places in a pixel, which a difference has twice
    spread_um = sigma_um * math.sqrt(2 / len(SEEDS) + 2 / len(WRONG) ** 2)
    assert np.linalg.norm(wanted) > 0.15
    np.testing.assert_allclose(moved, wanted, rtol=0, atol=3 * spread_um)
    assert sigmas(looked.wrong.errors_um, sigma_um) > 2
