"""Scale and image shift by zoom, and the frame of a look."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.executor.devices.calibration import (
    Calibration,
    ZoomPoint,
    look_frame,
    placed_look,
    planned_pose,
)
from microplan.schemas.plan import Look
from microplan.schemas.pose import Pose
from tests.executor.bench import plan_of
from tests.executor.disc import REGION, look

LOW = ZoomPoint(magnification=5.0, um_per_px=1.6, shift_um=(0.0, 2.0))  # 8 um pixels
HIGH = ZoomPoint(magnification=20.0, um_per_px=0.45, shift_um=(4.0, 0.0))  # 9 um pixels


def test_between_two_zooms_pitch_and_shift_are_linear_in_the_logarithm() -> None:
    middle = Calibration(zooms=(LOW, HIGH)).at(10.0)  # half way from 5 to 20
    assert middle is not None
    assert middle.um_per_px == pytest.approx(8.5 / 10.0)
    assert middle.shift_um == pytest.approx((2.0, 1.0))


@pytest.mark.parametrize("point", [LOW, HIGH])
def test_a_calibrated_zoom_is_itself(point: ZoomPoint) -> None:
    for zooms in ((LOW, HIGH), (point,)):
        found = Calibration(zooms=zooms).at(point.magnification)
        assert found is not None
        assert found.um_per_px == pytest.approx(point.um_per_px)
        assert found.shift_um == pytest.approx(point.shift_um)


def test_beyond_the_calibrated_zooms_nothing_is_said() -> None:
    found = Calibration(zooms=(LOW, HIGH))
    assert found.at(4.9) is None
    assert found.at(20.1) is None
    assert found.at(20.01) is not None  # the same zoom, as drives repeat


def test_a_mirror_is_a_negative_determinant() -> None:
    turned = ((0.0, -1.0), (1.0, 0.0))
    swapped = ((0.0, 1.0), (1.0, 0.0))
    assert not Calibration(zooms=(LOW,), camera_from_stage=turned).mirrored
    assert Calibration(zooms=(LOW,), camera_from_stage=swapped).mirrored


def test_a_looks_frame_undoes_the_shift_at_the_stations_scale() -> None:
    found, _ = look()
    need = plan_of(()).requirements
    plain = look_frame(found, need, None)
    zoom = found.view.magnification
    point = ZoomPoint(magnification=zoom, um_per_px=2.0, shift_um=(3.0, -1.0))
    frame = look_frame(found, need, Calibration(zooms=(point,)))
    x_um, y_um = plain.to_world(10.0, 20.0)
    assert frame.to_world(10.0, 20.0) == pytest.approx((2 * x_um - 3, 2 * y_um + 1))
    assert frame.to_pixel(*frame.to_world(10.0, 20.0)) == pytest.approx((10.0, 20.0))


# --- looks that follow

NEED = plan_of(()).requirements
SHIFTED = Calibration(
    zooms=(ZoomPoint(magnification=7.5, um_per_px=0.8, shift_um=(3.0, -2.0)),)
)
PLACES = st.floats(-900.0, 900.0)


def placed(found: Look, pose: Pose, calibration: Calibration | None) -> Look:
    frame = look_frame(found, NEED, calibration)
    return placed_look(found, NEED, frame, pose)


@given(PLACES, PLACES, st.floats(-math.pi, math.pi), st.sampled_from([None, SHIFTED]))
def test_a_region_follows_its_target_by_whole_pixels_within_the_frame(
    x_um: float, y_um: float, theta_rad: float, calibration: Calibration | None
) -> None:
    """What is seen at a pixel of it is as far from the target as planned."""
    plain = look()[0]
    aside = replace(plain.measure, offset_um=(30.0, 10.0), turn_rad=0.3)
    follows = replace(plain, view=replace(plain.view, follows=True), measure=aside)
    at = planned_pose(aside)
    expected = Pose(x_um=at.x_um + x_um, y_um=at.y_um + y_um, theta_rad=theta_rad)
    found = placed(follows, expected, calibration)
    region, pitch_um = found.measure.region, 1.0 if calibration is None else 0.8
    assert (region.rows, region.columns) == (REGION.rows, REGION.columns)
    assert 0 <= region.row <= NEED.height_px - region.rows
    assert 0 <= region.column <= NEED.width_px - region.columns
    now = planned_pose(found.measure)
    gone = (region.column - REGION.column, REGION.row - region.row)
    assert (now.x_um - at.x_um, now.y_um - at.y_um) == pytest.approx(
        (pitch_um * gone[0], pitch_um * gone[1])
    )
    wanted = (x_um / pitch_um, y_um / pitch_um)
    columns = (-REGION.column, NEED.width_px - region.columns - REGION.column)
    rows = (REGION.row - NEED.height_px + region.rows, REGION.row)
    for had, asked, (low, high) in zip(gone, wanted, (columns, rows), strict=True):
        assert had == pytest.approx(min(max(asked, low), high), abs=0.5 + 1e-9)
    assert placed(found, expected, calibration) is found  # it stays there


def test_a_look_that_does_not_follow_stays() -> None:
    plain = look()[0]
    assert placed(plain, Pose(x_um=50.0, y_um=9.0), None) is plain
