"""Looks after a correction start where the target must be."""

from __future__ import annotations

import io
import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from microplan.executor.devices.drivers import Counts
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.run_context import Rig
from microplan.executor.run.servo import align
from microplan.executor.run.warm_start import (
    STEP,
    FoundFeature,
    WarmStart,
    guess_from,
    nearest_routine,
)
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.featuresel.routines.circle import circle_caliper
from microplan.featuresel.routines.contract import Artifact, Measurement
from microplan.featuresel.routines.likelihood import likelihood
from microplan.optics.lens.sensor import expose
from microplan.schemas.plan import Look, Region, RoutineUse
from tests.executor.bench import control, measure
from tests.executor.disc import PictureCamera, noisy, rig_of
from tests.executor.disc import look as disc_look
from tests.executor.run.test_servo import ACTION
from tests.featuresel.fits import artifact, case, render

TOLERANCE_SIGMAS = 1.0  # of the stage: more than one look, most times
SEEDS = range(4)
CHAIN = ("circle_caliper", "likelihood")


@cache
def post_look() -> tuple[Look, Artifacts]:
    """Return a look at a post by its rim, then the fit."""
    found = case("post")
    caliper = circle_caliper.prepare(render("post"), found.target)
    assert isinstance(caliper, Artifact)
    arrays = {"circle_caliper": caliper, "likelihood": artifact("post")}
    versions = {"circle_caliper": circle_caliper.CIRCLE_CALIPER.version,
                "likelihood": likelihood.LIKELIHOOD.version}  # fmt: skip
    uses = tuple(
        RoutineUse(id=n, version=versions[n], parameters={}, arrays=None) for n in CHAIN
    )
    window = found.window
    region = Region(
        row=window.row, column=window.column, rows=window.rows, columns=window.columns
    )
    pixel = (found.target.column, found.target.row)
    view = replace(disc_look()[0].view, um_per_px=found.microscope.um_per_px)
    by = measure(uses, region, pixel, (0.0, 0.0), 60.0)
    by = replace(by, sigma_xy_um=0.02)
    look = replace(disc_look()[0], view=view, measure=by)
    return look, Artifacts({("disc", name): each for name, each in arrays.items()})


def rig_at(cell: Cell) -> tuple[Rig, io.StringIO]:
    """Return a rig whose camera draws the post at the gear's true place."""
    rng = np.random.default_rng(3)

    def show(_region: Region | None) -> Counts:
        pose = cell.truth.pose(cell.truth.bodies["gear"])
        found = case("post")  # it lies beside a pixel's middle
        image = render("post")(
            dx_um=pose.x_um - found.x_um, dy_um=pose.y_um - found.y_um
        )
        return expose(image, found.sensor, rng)

    rig, log = rig_of(cell, post_look()[1]), io.StringIO()
    rig.station = replace(rig.station, camera=PictureCamera(show))
    rig.journal = Journal(log, rig.station.clock)
    return rig, log


def run(stage_sigma_um: float, said_um: float | None, seed: int) -> list[list[str]]:
    """Align; return the routines of every look. What it says must be true."""
    cell = build_cell(noisy(stage_sigma_um), seed)
    rig, log = rig_at(cell)
    servo = control(
        gain=0.8,
        tolerance_xy_um=TOLERANCE_SIGMAS * stage_sigma_um,
        max_cycles=60,
        move_sigma_um=said_um,
    )
    ended = align(rig, ACTION, post_look()[0], servo)
    pose = cell.truth.pose(cell.truth.bodies["gear"])
    true_um = math.hypot(pose.x_um, pose.y_um)
    # the fit's own sigma is .002 px here, and the nominal image is the true one
    assert true_um == pytest.approx(ended.error_um, abs=0.01)
    events = [json.loads(line) for line in log.getvalue().splitlines()]
    return [e["at"]["routines"] for e in events if e["event"] == "seen"]


def test_a_fit_goes_on_from_its_place_in_another_region() -> None:
    """Less what is taken off: .3 and .1 pixels."""
    pixels = Measurement(
        column=20.3, row=30.1, theta_rad=None, score=1.0, spread_px=0.01, z_um=0.0
    )
    before = FoundFeature(x_um=0.0, y_um=0.0, pixels=pixels, bias_px=(0.3, 0.1))
    guess = guess_from(before, (20.0, 23.0), 0.0)
    assert (guess.column, guess.row) == pytest.approx((20.3, 23.1))


def later(stage_sigma_um: float, said_um: float | None) -> list[list[str]]:
    """Return the routines of all looks but the first, which the chain makes."""
    found = []
    for seed in SEEDS:
        first, *others = run(stage_sigma_um, said_um, seed)
        assert first == list(CHAIN)
        found += others
    assert len(found) > len(SEEDS)
    return found


def test_a_fine_stage_is_followed_by_single_steps() -> None:
    assert {tuple(each) for each in later(0.05, 0.05)} == {(STEP,)}


def test_a_coarser_stage_is_followed_by_the_fit_alone() -> None:
    assert {tuple(each) for each in later(0.3, 0.3)} == {("likelihood",)}


@pytest.mark.parametrize("said_um", [None, 1.0])
def test_a_stage_that_may_be_anywhere_is_searched_anew(said_um: float | None) -> None:
    assert {tuple(each) for each in later(0.05, said_um)} == {CHAIN}


def test_a_stage_worse_than_it_says_is_found_by_the_chain() -> None:
    """The step is refused, nothing wrong is believed: `run` compares with the truth."""
    found = {tuple(each) for each in later(0.5, 0.05)}
    assert CHAIN in found
    assert found <= {CHAIN, (STEP,)}  # some landings are near enough for a step


def test_the_reach_is_that_of_a_hand_over() -> None:
    """Three sigmas must fit into .35 px for a step, 2 px for the fit."""
    uses = post_look()[0].measure.chain
    pixels = Measurement(
        column=0.0, row=0.0, theta_rad=None, score=1.0, spread_px=0.01, z_um=0.0
    )
    before = FoundFeature(x_um=0.0, y_um=0.0, pixels=pixels, bias_px=(0.0, 0.0))
    blind = replace(before, pixels=replace(pixels, z_um=None))

    def routine(sigma_um: float, found: FoundFeature = before) -> str | None:
        warm_start = WarmStart(features={"gear": found}, sigma_um=sigma_um)
        return nearest_routine(uses, warm_start, found, 0.5)

    assert routine(0.5 * 0.349 / 3) == STEP
    assert routine(0.5 * 0.351 / 3) == "likelihood"
    assert routine(0.5 * 1.99 / 3) == "likelihood"
    assert routine(0.5 * 2.01 / 3) is None
    assert routine(math.inf) is None
    assert routine(math.nan) is None
    assert routine(0.0, blind) == "likelihood"  # one step needs to know the focus
    assert (
        nearest_routine(uses[:1], WarmStart(features={}, sigma_um=0.0), before, 1.0)
        is None
    )
