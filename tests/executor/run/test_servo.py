"""Alignment on a simulated stage."""

from __future__ import annotations

import io
import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from microplan.executor.devices.drivers import AxisReading, Counts
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.run.run_context import Rig
from microplan.executor.run.servo import (
    NOISE_PER_TOLERANCE,
    align,
    correction,
    diverges,
)
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.schemas.plan import AlignAction, Region
from microplan.schemas.pose import Pose
from tests.executor.bench import control
from tests.executor.disc import PictureCamera, disc, look, noisy, quiet_cell, rig_of

ACTION = AlignAction(target="gear", to="goal", look="disc", axes="stage", path=("xy",))


class SteppedStage:
    """A stage that moves by what is asked plus noise, from where it truly is."""

    model, serial = "stepped", "0"

    def __init__(self, cell: Cell, sigma_um: float, seed: int) -> None:
        self._truth = cell.truth
        self._sigma_um = sigma_um
        self._rng = np.random.default_rng(seed)

    def start(
        self,
        *,
        x_um: float | None = None,
        y_um: float | None = None,
        z_um: float | None = None,
        theta_rad: float | None = None,
        speed_um_per_s: float | None = None,
    ) -> None:
        """Move x and y at once."""
        state = self._truth.stage
        for name, value in (("x_um", x_um), ("y_um", y_um)):
            assert value is not None
            error_um = self._sigma_um * self._rng.standard_normal()
            state.actual[name] += value - state.commanded[name] + error_um
            state.commanded[name] = value

    def moving(self) -> bool:
        """Return whether it moves: it is there at once."""
        return False

    def reading(self) -> AxisReading:
        """Return the commanded reading."""
        return AxisReading(**self._truth.stage.commanded)

    def stop(self) -> None:
        """Do nothing: it never moves for long."""


EVERY_RATIO = pytest.mark.parametrize(  # tolerance over the sigma of a move
    ("ratio", "runs"),
    [
        (1.5, 20),
        *(pytest.param(ratio, 80, marks=pytest.mark.slow) for ratio in (0.8, 1.5)),
    ],
)


@EVERY_RATIO
def test_moves_from_the_true_place_take_as_many_as_the_closed_form(
    ratio: float, runs: int
) -> None:
    found, artifacts = look()
    servo = control(gain=1.0, tolerance_xy_um=ratio, max_cycles=200)
    cycles = []
    for seed in range(runs):
        cell = quiet_cell()
        rig = rig_of(cell, artifacts)
        rig.station = replace(rig.station, stage=SteppedStage(cell, 1.0, seed))
        cycles.append(align(rig, ACTION, found, servo).cycles)
    # at gain 1 every move lands afresh, inside with chance p (Rayleigh): geometric
    p = 1 - math.exp(-(ratio**2) / 2)
    spread = math.sqrt(1 - p) / p / math.sqrt(runs)
    assert abs(np.mean(cycles) - 1 / p) < 3.5 * spread


@EVERY_RATIO
def test_moves_that_repeat_to_a_reading_take_more(ratio: float, runs: int) -> None:
    # The simulated stage scatters about the reading, so a correction carries the last
    # error along: e[k+1] = (1 - g) e[k] + n[k+1] - n[k], variance 2 / (2 - g) sigma^2.
    found, artifacts = look()
    gain = 0.8
    servo = control(gain=gain, tolerance_xy_um=ratio, max_cycles=200)
    cycles = []
    for seed in range(runs):
        rig = rig_of(build_cell(noisy(1.0), seed), artifacts)
        cycles.append(align(rig, ACTION, found, servo).cycles)
    predicted = recursion(gain, ratio)
    spread = float(np.std(predicted)) / math.sqrt(runs)
    assert abs(np.mean(cycles) - np.mean(predicted)) < 3.5 * spread


def recursion(gain: float, ratio: float) -> list[int]:
    """Return how many looks 4000 alignments of the plain recursion take."""
    rng = np.random.default_rng(0)
    counts = []
    for _ in range(4000):
        noise = rng.standard_normal(2)
        error, count = noise, 1
        while np.hypot(*error) > ratio:
            fresh = rng.standard_normal(2)
            error, noise = (1 - gain) * error + fresh - noise, fresh
            count += 1
        counts.append(count)
    return counts


def test_nothing_moves_once_inside_the_tolerance() -> None:
    found, artifacts = look()
    cell = quiet_cell()
    rig = rig_of(cell, artifacts)
    ended = align(rig, ACTION, found, control(tolerance_xy_um=0.5))
    assert ended.cycles == 1
    assert cell.station.stage.reading().x_um == -600.0


def test_a_wrong_belief_is_corrected_geometrically() -> None:
    found, artifacts = look()
    cell = quiet_cell()
    rig = rig_of(cell, artifacts)
    rig.beliefs.update("gear", rig.readings(), 10.0, 0.0, None)  # it is at 0
    ended = align(rig, ACTION, found, control(gain=0.8, tolerance_xy_um=0.5))
    assert ended.cycles == 3  # errors 10, 2, .4 um
    assert ended.error_um == pytest.approx(0.4, abs=0.05)


def test_look_then_move_corrects_once() -> None:
    found, artifacts = look()
    cell = quiet_cell()
    rig = rig_of(cell, artifacts)
    rig.beliefs.update("gear", rig.readings(), 10.0, 0.0, None)
    servo = control(method="look_then_move", max_cycles=1)
    ended = align(rig, ACTION, found, servo)
    assert ended.cycles == 1
    true = cell.truth.pose(cell.truth.bodies["gear"])
    assert true.x_um == pytest.approx(0.0, abs=0.05)


def test_look_then_move_corrects_what_is_inside_the_tolerance_too() -> None:
    found, artifacts = look()
    cell = quiet_cell()
    rig = rig_of(cell, artifacts)
    rig.beliefs.update("goal", rig.readings(), 0.3, 0.0, None)
    once = control(method="look_then_move", tolerance_xy_um=0.5, max_cycles=1)
    align(rig, ACTION, found, once)
    true = cell.truth.pose(cell.truth.bodies["gear"])
    assert true.x_um == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize("seed", range(5))
def test_a_mirrored_camera_is_caught_and_the_stage_stopped(seed: int) -> None:
    found, artifacts = look()
    cell = build_cell(noisy(1.0), seed)
    cell.truth.bodies["gear"].pose = Pose(x_um=604.0, y_um=0.0)  # believed at 600
    rig = rig_of(cell, artifacts, mirror=True)
    with pytest.raises(ExecutorError, match="mirrored or swapped") as caught:
        align(rig, ACTION, found, control(tolerance_xy_um=0.8))
    assert caught.value.code == "MP831"
    pose = cell.truth.pose(cell.truth.bodies["gear"])
    assert math.hypot(pose.x_um, pose.y_um) < 30.0  # it did not run far


def test_an_alignment_that_cannot_end_gives_up() -> None:
    found, artifacts = look()
    rig = rig_of(build_cell(noisy(1.0), 3), artifacts)
    with pytest.raises(ExecutorError, match="after 4 looks") as caught:
        align(rig, ACTION, found, control(tolerance_xy_um=0.02, max_cycles=4))
    assert caught.value.code in ("MP830", "MP831")


def test_a_correction_beyond_the_limit_is_refused() -> None:
    found, artifacts = look()
    rig = rig_of(quiet_cell(), artifacts)
    rig.beliefs.update("gear", rig.readings(), 10.0, 0.0, None)
    with pytest.raises(ExecutorError, match="a correction may be 5 um") as caught:
        align(rig, ACTION, found, control(max_step_um=5.0))
    assert caught.value.code == "MP832"


def test_noise_alone_is_not_divergence() -> None:
    tolerance_um = 1.0
    limit_um = NOISE_PER_TOLERANCE * math.sqrt(2 / 1.2) * tolerance_um
    assert not diverges([0.5, 1.0, 0.99 * limit_um], tolerance_um, 0.8)
    assert not diverges([9.0, 8.0, 9.0], tolerance_um, 0.8)
    assert diverges([2.0, 4.0, 1.01 * limit_um], tolerance_um, 0.8)
    for unstable in (2.0, 3.0):  # refused before a run; no noise would be bounded
        assert diverges([1e-3, 2e-3, 3e-3], tolerance_um, unstable)
        assert not diverges([3e-3, 2e-3, 3e-3], tolerance_um, unstable)


def test_a_turn_is_made_up_for_in_x_and_y() -> None:
    _, artifacts = look()
    cell = quiet_cell()
    rig = rig_of(cell, artifacts)
    rig.beliefs.update("goal", rig.readings(), 30.0, -40.0, 0.5)
    servo = control(tolerance_theta_rad=0.01)
    rig.move(correction(rig, ACTION, servo, 1.0))
    true = cell.truth.pose(cell.truth.bodies["gear"])
    assert (true.x_um, true.y_um) == pytest.approx((30.0, -40.0), abs=1e-9)
    assert true.theta_rad == pytest.approx(0.5)


@pytest.mark.parametrize(("still_rad", "turned"), [(0.4, True), (0.6, False)])
def test_an_angle_inside_its_tolerance_is_left(
    still_rad: float, *, turned: bool
) -> None:
    """What is outside is turned all the way, whatever the gain of x and y is."""
    _, artifacts = look()
    cell = quiet_cell()
    rig = rig_of(cell, artifacts)
    rig.beliefs.update("goal", rig.readings(), 30.0, -40.0, 0.5)
    servo = control(tolerance_theta_rad=still_rad)
    move = correction(rig, ACTION, servo, 0.8, still_rad)
    assert (move.theta_rad is not None) is turned
    rig.move(move)
    true = cell.truth.pose(cell.truth.bodies["gear"])
    assert (true.x_um, true.y_um) == pytest.approx((24.0, -32.0), abs=1e-9)
    assert true.theta_rad == pytest.approx(0.5 if turned else 0.0)


def blinking(cell: Cell, hidden: Sequence[int]) -> PictureCamera:
    """Return a camera that shows nothing in some of its pictures, counted from 0."""
    count = itertools.count()

    def show(region: Region | None) -> Counts:
        pose = cell.truth.pose(cell.truth.bodies["gear"])
        image = disc(900.0, 0.0) if next(count) in hidden else disc(pose.x_um, 0.0)
        return np.rint(255 * image).astype(np.uint8)

    return PictureCamera(show)


def aligned_blinking(*hidden: int) -> tuple[Rig, int]:
    """Return the rig, and the looks, of an alignment that corrects 10, 2 and .4 um."""
    found, artifacts = look()
    cell = quiet_cell()
    rig = rig_of(cell, artifacts, camera=blinking(cell, hidden))
    rig.beliefs.update("gear", rig.readings(), 10.0, 0.0, None)  # it is at 0
    return rig, align(rig, ACTION, found, control(tolerance_xy_um=0.5)).cycles


def test_a_target_that_is_lost_is_looked_for_where_it_was_seen_last() -> None:
    rig, cycles = aligned_blinking(1)
    stream = rig.journal._stream
    assert isinstance(stream, io.StringIO)
    events = [json.loads(line) for line in stream.getvalue().splitlines()]
    moves = [e["to"]["x_um"] for e in events if e["event"] == "move"]
    lost = [e for e in events if e["event"] == "lost"]
    assert [e["code"] for e in lost] == ["MP820"]
    assert moves[2] == moves[0] == lost[0]["back"]["x_um"]  # the approach's reading
    assert cycles == 4  # one more than without: the first error is measured twice


@pytest.mark.parametrize("hidden", [(0,), (1, 2), (1, 3)])
def test_a_target_that_stays_lost_ends_the_alignment(hidden: tuple[int, ...]) -> None:
    # never seen; not seen again where it was; lost twice
    with pytest.raises(ExecutorError) as ended:
        aligned_blinking(*hidden)
    assert ended.value.code == "MP820"


@pytest.mark.parametrize("gain", [0.5, 0.8, 1.0])
def test_noise_alone_is_no_divergence(gain: float) -> None:
    """The least tolerance that is allowed, on axes that land about their reading."""
    rng, runs, tolerance_um = np.random.default_rng(4), 3000, 0.6
    stopped = 0
    for _ in range(runs):
        landed = rng.normal(0.0, 1.0, 2)
        error, errors_um = landed.copy(), list[float]()
        for _ in range(60):
            errors_um.append(math.hypot(*error))
            if errors_um[-1] <= tolerance_um:
                break
            if diverges(errors_um, tolerance_um, gain):
                stopped += 1
                break
            before, landed = landed, rng.normal(0.0, 1.0, 2)
            error = (1 - gain) * error + landed - before
    # some 8 looks a run, each with 4e-6: one in 3000 runs has a chance of .1
    assert stopped <= 1
