"""A look at two features of one part: joined, missed, or at odds."""

from __future__ import annotations

import cmath
import io
import itertools
import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import cast

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.executor.devices.drivers import Counts
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.measure_target import look_at
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated.cell import Cell
from microplan.featuresel.routines.circle import circle_caliper
from microplan.featuresel.routines.contract import Artifact, LookModel, Target
from microplan.schemas.plan import (
    Look,
    Measure,
    OnFailure,
    Region,
    RoutineUse,
    Together,
)
from microplan.schemas.pose import Pose
from tests.executor.bench import measure
from tests.executor.disc import CENTER, REGION, SIDE, PictureCamera, quiet_cell, rig_of
from tests.executor.disc import look as disc_look

RADIUS_UM, ARM_UM, SIGMA_UM = 9.0, 22.0, 0.1
ARMS = {"gear.left": -ARM_UM, "gear.right": ARM_UM}
DARK = np.full((SIDE, SIDE), 0.2)


def discs(*centers: complex) -> FloatArray:
    """Return discs about points of the world, edges one pixel wide."""
    row, column = np.mgrid[0:SIDE, 0:SIDE]
    image = DARK.copy()
    for center in centers:
        away = np.hypot(column - CENTER[0] - center.real, CENTER[1] - row - center.imag)
        image += 0.6 * np.clip(RADIUS_UM - away + 0.5, 0.0, 1.0)
    return image


def part_camera(
    cell: Cell, arms_um: tuple[float, ...], *, dark: int = 0
) -> PictureCamera:
    """Return a camera that sees the gear as two discs; its first frames may be dark."""
    frames = itertools.count()

    def show(region: Region | None) -> Counts:
        assert region == REGION
        pose = cell.truth.pose(cell.truth.bodies["gear"])
        at, turn = complex(pose.x_um, pose.y_um), cmath.rect(1.0, pose.theta_rad)
        image = (
            DARK if next(frames) < dark else discs(*(at + turn * a for a in arms_um))
        )
        return np.rint(255 * image).astype(np.uint8)

    return PictureCamera(show)


@cache
def artifact(name: str) -> Artifact:
    """Return what the routine needs to find one of the discs."""

    def picture(
        *, dx_um: float = 0.0, dy_um: float = 0.0, theta_rad: float = 0.0
    ) -> FloatArray:
        turn = cmath.rect(1.0, theta_rad)
        return discs(*(complex(dx_um, dy_um) + turn * arm for arm in ARMS.values()))

    target = Target(
        name=name, kind="circle", column=CENTER[0] + ARMS[name], row=CENTER[1],
        theta_rad=0.0, px_per_um=1.0, search_px=8.0, theta_range_rad=0.1, symmetry=0,
        bright=True, parameters={"radius_um": RADIUS_UM},
    )  # fmt: skip
    found = circle_caliper.prepare(cast(LookModel, picture), target)
    assert isinstance(found, Artifact), found
    return found


def measured(name: str) -> Measure:
    """Return how one of the discs is measured."""
    use = RoutineUse(
        id="circle_caliper", version=circle_caliper.CIRCLE_CALIPER.version,
        parameters=artifact(name).parameters, arrays=None,
    )  # fmt: skip
    pixel = (CENTER[0] + ARMS[name], CENTER[1])
    found = measure((use,), REGION, pixel, (ARMS[name], 0.0), 15.0)
    return replace(
        found, feature=name, offset_um=(ARMS[name], 0.0), sigma_xy_um=SIGMA_UM
    )


def look(*names: str, least: int = 2) -> Look:
    """Return a look that measures the discs of these names, in this order."""
    first, *others = map(measured, names or tuple(ARMS))
    plain, _ = disc_look()
    together = Together(
        sigma_xy_um=SIGMA_UM, sigma_theta_rad=None, conditioning=2.0, dropped_um=None,
        least=least, success_lower=0.9, silent_upper=0.01,
    )  # fmt: skip
    return replace(plain, measure=first, others=tuple(others), together=together)


def seeing(pose: Pose, arms_um: tuple[float, ...], *, dark: int = 0) -> Rig:
    """Return a rig whose gear is believed at the origin and is at `pose`."""
    cell = quiet_cell()
    cell.truth.bodies["gear"].pose = replace(pose, x_um=600.0 + pose.x_um)
    found: dict[tuple[str, str | None], Artifact] = {
        (f"disc.{name}", "circle_caliper"): artifact(name) for name in ARMS
    }
    rig = rig_of(cell, Artifacts(found))
    camera = part_camera(cell, arms_um, dark=dark)
    rig.station = replace(rig.station, camera=camera)
    rig.journal = Journal(io.StringIO(), rig.station.clock)
    return rig


def believe(rig: Rig, theta_rad: float) -> None:
    """Let the gear be believed at the origin, at a known angle."""
    rig.beliefs.update("gear", rig.readings(), 0.0, 0.0, theta_rad)


def journal(stream: io.StringIO) -> list[dict[str, object]]:
    return [json.loads(line) for line in stream.getvalue().splitlines()]


BOTH = (-ARM_UM, ARM_UM)
AT = Pose(x_um=2.25, y_um=-1.5, theta_rad=0.05)


def test_two_features_tell_place_and_angle() -> None:
    rig = seeing(AT, BOTH)
    seen = look_at(rig, look())
    # each disc is found to .02 um, see the tests of one; two of them over their arm
    assert (seen.x_um, seen.y_um) == pytest.approx((AT.x_um, AT.y_um), abs=0.02)
    assert seen.theta_rad == pytest.approx(AT.theta_rad, abs=0.02 / ARM_UM)
    assert seen.routines == ("circle_caliper", "circle_caliper")
    known = rig.beliefs.world("gear", rig.readings())
    assert known.theta_rad == pytest.approx(seen.theta_rad)


def test_the_order_of_the_features_does_not_matter() -> None:
    names = tuple(ARMS)
    one = look_at(seeing(AT, BOTH), look(*names))
    two = look_at(seeing(AT, BOTH), look(*names[::-1]))
    # least squares of the same numbers, summed in another order
    assert (two.x_um, two.y_um) == pytest.approx((one.x_um, one.y_um), abs=1e-10)
    assert two.theta_rad == pytest.approx(one.theta_rad, abs=1e-10)
    assert (two.score, two.spread_um) == (one.score, one.spread_um)


def test_features_farther_apart_than_drawn_are_refused() -> None:
    """By 2 um where each is known to .1: chi-square is 200, at most 15 is believed."""
    rig = seeing(AT, (-ARM_UM, ARM_UM + 2.0))
    with pytest.raises(ExecutorError, match="chi-square") as caught:
        look_at(rig, look())
    assert (caught.value.code, caught.value.cause) == ("MP826", "features_disagree")
    assert rig.beliefs.world("gear", rig.readings()).x_um == 0.0


def test_a_disagreement_may_be_tried_again() -> None:
    rig = seeing(AT, (-ARM_UM, ARM_UM + 2.0))
    stream = io.StringIO()
    rig.journal = Journal(stream, rig.station.clock)
    with pytest.raises(ExecutorError) as caught:
        look_at(rig, look(), (OnFailure(code="MP826", do="retry", times=2),))
    assert caught.value.code == "MP826"
    assert [e["event"] for e in journal(stream)].count("look") == 3


@pytest.mark.parametrize("shown", BOTH)
def test_a_missed_feature_is_noted_where_one_is_enough(shown: float) -> None:
    rig = seeing(AT, (shown,))
    believe(rig, AT.theta_rad)
    stream = io.StringIO()
    rig.journal = Journal(stream, rig.station.clock)
    seen = look_at(rig, look(least=1))
    assert (seen.x_um, seen.y_um) == pytest.approx((AT.x_um, AT.y_um), abs=0.02)
    assert seen.theta_rad is None  # it was believed, not measured
    (missed,) = (e for e in journal(stream) if e["event"] == "missed")
    assert missed["code"] == "MP820"
    (hidden,) = (name for name, arm in ARMS.items() if arm != shown)
    assert hidden in str(missed["why"])


def test_a_missed_feature_is_a_failure_where_all_must_answer() -> None:
    rig = seeing(AT, (-ARM_UM,))
    believe(rig, AT.theta_rad)
    with pytest.raises(ExecutorError, match=r"gear\.right not found") as caught:
        look_at(rig, look(least=2))
    assert caught.value.code == "MP820"


def test_one_feature_off_the_target_needs_the_angle() -> None:
    rig = seeing(replace(AT, theta_rad=0.0), (-ARM_UM,))
    with pytest.raises(ExecutorError) as caught:
        look_at(rig, look(least=1))
    assert (caught.value.code, caught.value.cause) == ("MP826", "no_angle")


def one_after_the_other(cameras: Sequence[PictureCamera]) -> PictureCamera:
    """Return a camera whose frames are those of others in turn, at last the same."""
    left = list(cameras)

    def show(region: Region | None) -> Counts:
        camera = left.pop(0) if len(left) > 1 else left[0]
        return camera.grab(region).counts

    return PictureCamera(show)


def in_turn(rig: Rig, *shown: tuple[float, ...]) -> Rig:
    """Let a rig's frames show these arms, one set after the other."""
    cell = quiet_cell()
    cell.truth.bodies["gear"].pose = replace(AT, x_um=600.0 + AT.x_um)
    camera = one_after_the_other([part_camera(cell, arms) for arms in shown])
    rig.station = replace(rig.station, camera=camera)
    return rig


def with_stops(found: Look, count: int) -> Look:
    """Return a look with further focus stops."""
    stops = tuple(found.view.focus_um + 5.0 * k for k in range(1, count + 1))
    return replace(found, view=replace(found.view, focus_stops_um=stops))


def test_features_may_be_found_at_different_focus_stops() -> None:
    """As where they accept different heights of the focus, and none shows both."""
    rig = in_turn(seeing(AT, BOTH), (-ARM_UM,), (ARM_UM,))
    seen = look_at(rig, with_stops(look(least=2), 1))
    assert seen.frames == 2
    assert (seen.x_um, seen.y_um) == pytest.approx((AT.x_um, AT.y_um), abs=0.02)
    assert seen.theta_rad == pytest.approx(AT.theta_rad, abs=0.02 / ARM_UM)


def test_features_that_no_stop_shows_are_missed_at_all_of_them() -> None:
    rig = in_turn(seeing(AT, BOTH), (-ARM_UM,), (), (-ARM_UM,))
    with pytest.raises(ExecutorError, match=r"gear\.right not found"):
        look_at(rig, with_stops(look(least=2), 2))
