"""Which gains settle when frames are old, and that no other begins."""

from __future__ import annotations

import cmath
import math
from collections import deque

import numpy as np
import pytest

from benchmarks.executing.servo_gain import GAINS, course
from microplan.executor.devices.calibration import (
    Calibration,
    ZoomPoint,
    check_gains,
    stable_gain,
)
from microplan.executor.devices.drivers import Counts
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.run.servo import align
from microplan.executor.simulated.cell import Cell
from microplan.schemas.plan import AlignAction, Plan, Region
from tests.executor.bench import control, plan_of, step
from tests.executor.disc import PictureCamera, disc, look, quiet_cell, rig_of

ACTION = AlignAction(target="gear", to="goal", look="disc", axes="stage", path=("xy",))


def plan(gain: float, **changes: str) -> Plan:
    """Return a plan of one alignment."""
    return plan_of([step("align", ACTION, servo=control(gain=gain, **changes))])


@pytest.mark.parametrize("latency", [0, 1, 2, 3])
@pytest.mark.parametrize("turn_rad", [0.0, 0.3, -1.2])
def test_the_limit_is_where_the_largest_root_is_one(
    latency: int, turn_rad: float
) -> None:
    limit = stable_gain(latency, turn_rad)
    for share in (0.98, 1.02):
        delayed = share * limit * cmath.exp(1j * turn_rad)
        # z^(d + 1) - z^d + g e^(i phi)
        rows = [1.0 + 0j, -1.0 + 0j, *[0j] * (latency + 1)]
        rows[latency + 1] += delayed
        roots = np.roots(rows[: latency + 2])
        assert (np.abs(roots).max() < 1) == (share < 1)


def test_limits_are_those_of_the_page() -> None:
    limits = [stable_gain(d) for d in range(4)]
    assert limits == pytest.approx([2.0, 1.0, 0.618, 0.445], abs=5e-4)
    assert stable_gain(0, math.pi / 2) == pytest.approx(0.0, abs=1e-12)
    assert stable_gain(1, 3.0) == 0.0
    with pytest.raises(ValueError, match="0 or more"):
        stable_gain(-1)


def late_camera(cell: Cell, latency: int) -> PictureCamera:
    """Return a camera that shows what was so some looks ago."""
    kept: deque[tuple[float, float]] = deque(maxlen=latency + 1)

    def show(region: Region | None) -> Counts:
        pose = cell.truth.pose(cell.truth.bodies["gear"])
        kept.append((pose.x_um, pose.y_um))
        return np.rint(255 * disc(*kept[0])).astype(np.uint8)

    return PictureCamera(show)


@pytest.mark.parametrize("latency", [1, 2])
@pytest.mark.parametrize("share", [0.35, 1.25])
def test_an_alignment_by_old_frames_settles_below_the_limit_alone(
    latency: int, share: float
) -> None:
    found, artifacts = look()
    cell = quiet_cell()
    rig = rig_of(cell, artifacts, camera=late_camera(cell, latency))
    rig.beliefs.update("gear", rig.readings(), 2.0, 0.0, None)  # it is at 0
    gain = share * stable_gain(latency)
    servo = control(gain=gain, tolerance_xy_um=0.1, max_cycles=60)
    if share < 1:
        assert align(rig, ACTION, found, servo).error_um <= 0.1
        return
    with pytest.raises(ExecutorError) as ended:
        align(rig, ACTION, found, servo)
    assert ended.value.code == "MP831"


def test_a_gain_beyond_the_limit_is_refused_before_anything_moves() -> None:
    check_gains(plan(0.8), 1, None)
    for gain, latency in ((0.8, 2), (1.01, 1), (2.0, 0), (0.0, 0), (-0.8, 0)):
        with pytest.raises(ExecutorError) as refused:
            check_gains(plan(gain), latency, None)
        assert refused.value.code == "MP837"
    check_gains(plan(0.8, method="look_then_move"), 3, None)  # no loop


def test_scale_and_turn_of_the_image_count() -> None:
    def turned(angle_rad: float, scale: float) -> Calibration:
        c, s = scale * math.cos(angle_rad), scale * math.sin(angle_rad)
        point = ZoomPoint(magnification=7.5, um_per_px=1.0)
        return Calibration(zooms=(point,), camera_from_stage=((c, -s), (s, c)))

    limit = stable_gain(1, 0.4)
    check_gains(plan(0.99 * limit / 1.1), 1, turned(0.4, 1.1))
    with pytest.raises(ExecutorError, match=r"scaled by 1\.1"):
        check_gains(plan(1.01 * limit / 1.1), 1, turned(-0.4, 1.1))


def test_a_falling_gain_is_better_on_one_stage_and_worse_on_the_other() -> None:
    # why the gain stays as the plan has it
    fixed, falling = GAINS["0.8"], GAINS["1/k"]
    ours, other = (course("reading", g, 0.8, 4000).looks for g in (fixed, falling))
    assert other < 0.9 * ours
    ours, other = (course("place", g, 0.8, 4000).looks for g in (fixed, falling))
    assert other > 2 * ours
