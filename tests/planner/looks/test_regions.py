"""A look at each kind of region: its edges in the scene, its pose in the trials."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from microplan.featuresel.features.feature import contour_px
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.look_problem import Begun, CompileContext, LookProblem
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.presets import PRESETS
from microplan.planner.views.requests import requests
from microplan.planner.views.target_views import views
from tests.planner.chips import REGIONS, write_chip
from tests.planner.examples import read

TRIALS = 8
ACROSS_PX = 1.5  # to both sides of an edge, at 1.1 um a pixel


def evaluated(file: Path) -> Evaluation:
    """Return the trials of a task's only look at its first magnification."""
    task, report = read(file), Report()
    (asked,) = requests(task, unfold(task, report), 0, None)
    effort = replace(PRESETS["fast"], trials=TRIALS, random_trials=TRIALS)
    context = CompileContext(effort=effort, max_image_error=0.01, map=map)
    problem = LookProblem(task=task, request=asked, context=context, begun=Begun())
    return problem.evaluate(views(task, asked, 6.9, report)[0])


def step_across(case: LookCase, *, hole: bool) -> np.ndarray:
    """Return inside minus outside at the points of the target's contour, (N,)."""
    image = nominal_render(case)().astype(np.float32)
    column, row = contour_px(case.target)
    c, s = math.cos(case.target.theta_rad), math.sin(case.target.theta_rad)
    nx, ny = np.array(case.target.contour)[:, 2:].T * (-1 if hole else 1)
    dx, dy = ACROSS_PX * (c * nx - s * ny), -ACROSS_PX * (s * nx + c * ny)
    seen = [
        cv2.remap(
            image,
            (column + side * dx).astype(np.float32),
            (row + side * dy).astype(np.float32),
            cv2.INTER_LINEAR,
        )
        for side in (-1, 1)
    ]
    return (seen[0] - seen[1]).ravel()


# the others are as bright and as symmetric as the pad, or nearly
QUICK = ("slot", "pocket", "pad")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow])
        for name in REGIONS
    ],
)
def test_a_region_is_located_with_its_angle(tmp_path: Path, name: str) -> None:
    """Its own ring is an edge all along, and chains find it within the look's limits.

    One that matches edges and one that matches the image are among them.
    """
    found = evaluated(write_chip(tmp_path / "task", target=f"chip.{name}"))
    case, (_, order, bright) = found.case, REGIONS[name]
    assert (case.target.kind, case.target.symmetry) == ("outline", order)
    assert case.target.bright == bright
    across = step_across(case, hole=name == "slot")
    assert ((across > 0) == bright).all()
    assert np.abs(across).min() > 0.02  # of full scale, also where corners are round
    chosen = found.comparison.selection.chosen
    assert chosen is not None
    assert chosen.need_um <= case.tolerance_um
    assert chosen.sigma_theta_rad is not None
    assert case.tolerance_theta_rad is not None
    assert 2 * chosen.sigma_theta_rad <= case.tolerance_theta_rad
    right = {s.chain for s in found.comparison.scores if s.success == TRIALS}
    assert {("contour_match",), ("ncc",)} <= right
