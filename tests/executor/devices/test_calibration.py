"""Scale and image shift by zoom, and the frame of a look."""

from __future__ import annotations

import pytest

from microplan.executor.devices.calibration import Calibration, ZoomPoint, look_frame
from tests.executor.bench import plan_of
from tests.executor.disc import look

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
