"""A stage's axes in the image: what places were made with comes out, or is refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.planner.calibration.estimates import Refused
from microplan.planner.calibration.geometry.affine_scale import (
    pitches,
    scales,
    stretch_of,
)
from microplan.planner.calibration.geometry.stage_fit import StageFit, fit_stage
from microplan.planner.calibration.geometry.stage_stop import StageStop

CORNER_PX = 400.0
GRID = [(x, y) for x in (-90.0, -30.0, 30.0, 90.0) for y in (-60.0, 0.0, 60.0)]
MIRRORED = np.array([[-2.5, 0.02], [0.01, 2.45]])  # px/um


def stops_at(
    readings: Sequence[tuple[float, float]],
    matrix: FloatArray,
    *,
    noise_px: float = 0.05,
    bend: float = 0.0,
    seed: int = 0,
) -> list[StageStop]:
    """Return stops whose places err by so much, seen through a distortion."""
    rng = np.random.default_rng(seed)
    found = []
    for x, y in readings:
        place = matrix @ (x, y) + (12.0, -7.0) + rng.normal(0, noise_px, 2)
        place = place * (1 + bend * (place @ place) / CORNER_PX**2)
        right, up = place.tolist()
        found.append(StageStop(x_um=x, y_um=y, right_px=right, up_px=up))
    return found


def fitted(stops: Sequence[StageStop]) -> StageFit:
    found = fit_stage(stops, CORNER_PX)
    assert isinstance(found, StageFit), found
    return found


def test_numbers_come_out_within_their_deviations() -> None:
    """The mean square of pulls of 9 free numbers is 9/7, of 60 within a quarter."""
    true = dict(zip(("pitch_x", "pitch_y", "skew"), pitches(stretch_of(MIRRORED)),
                    strict=True), right_x=-2.5, up_y=2.45)  # fmt: skip
    pulls = []
    for seed in range(12):
        fit = fitted(stops_at(GRID, MIRRORED, seed=seed))
        for name, value in true.items():
            one = fit.one(name)
            assert one is not None
            assert one.sigma
            pulls.append((one.value - value) / one.sigma)
    assert np.max(np.abs(pulls)) < 5
    assert 0.7 < np.mean(np.square(pulls)) < 2.2


def test_axes_are_told_by_signs_and_noise_by_scatter() -> None:
    fit = fitted(stops_at(GRID * 3, MIRRORED, noise_px=0.2))
    np.testing.assert_allclose(fit.matrix(), MIRRORED, atol=0.01)
    for noise in fit.residual_px:
        assert noise.sigma is not None
        assert abs(noise.value - 0.2) < 4 * noise.sigma


def test_vibration_at_a_stop_is_no_noise_of_the_stage() -> None:
    """Of four pictures a stop, whose mean it moves by half of itself."""
    rng = np.random.default_rng(3)
    found = []
    for stop in stops_at(GRID * 4, MIRRORED, noise_px=0.1):
        seen = (stop.right_px, stop.up_px) + rng.normal(0, 0.3, (4, 2))
        right, up = seen.mean(axis=0).tolist()
        squares = np.sum((seen - seen.mean(axis=0)) ** 2, axis=0).tolist()
        found.append(
            replace(stop, right_px=right, up_px=up, pictures=4,
                    scatter_px=(squares[0], squares[1]))
        )  # fmt: skip
    fit = fitted(found)
    assert fit.shake_px == pytest.approx((0.3, 0.3), rel=0.25)
    for noise in fit.residual_px:
        assert noise.sigma is not None
        assert abs(noise.value - 0.1) < 4 * noise.sigma
        assert noise.value < 0.17  # less than with the vibration in it


def test_a_distortion_stays_only_if_stops_left_out_are_foretold_better() -> None:
    bent = fitted(stops_at(GRID, MIRRORED, bend=0.01)).one("distortion")
    assert bent is not None
    assert bent.sigma is not None
    assert abs(bent.value - 0.01) < 4 * bent.sigma
    nine = [(x, y) for x in (-80.0, 0.0, 80.0) for y in (-60.0, 0.0, 60.0)]
    straight = [
        fitted(stops_at(nine, MIRRORED, seed=seed)).one("distortion")
        for seed in range(30)
    ]
    assert straight.count(None) >= 28  # three deviations, of nine stops, by chance


def test_a_stop_far_off_moves_little_and_is_named() -> None:
    stops = stops_at(GRID, MIRRORED)
    stops[4] = StageStop(x_um=-30.0, y_um=0.0, right_px=200.0, up_px=5.0)
    fit = fitted(stops)
    assert fit.off == (4,)
    np.testing.assert_allclose(fit.matrix(), MIRRORED, atol=0.02)


def test_few_stops_have_no_deviation_and_fewer_are_refused() -> None:
    five = fitted(stops_at([*GRID[:3], *GRID[9:11]], MIRRORED)).one("pitch_x")
    assert five is not None
    assert five.sigma is None
    for readings, why in (
        (GRID[:3], "3 places of the stage, 4 are needed"),
        (GRID[:1] * 20, "1 places"),
        ([(10.0 * k, 5.0 * k) for k in range(20)], "on a line"),
    ):
        found = fit_stage(stops_at(readings, MIRRORED), CORNER_PX)
        assert isinstance(found, Refused)
        assert why in found.why
        assert "six places of the stage" in found.take


@pytest.mark.parametrize("turn", [0.0, 0.4, 3.0])
def test_pitches_do_not_depend_on_how_the_ruler_lies(turn: float) -> None:
    c, s = np.cos(turn), np.sin(turn)
    camera = np.array([[2.0, 0.01], [0.01, 2.1]])
    for mirror in (1, -1):
        ruler = np.array([[c, -s * mirror], [s, c * mirror]])
        found = pitches(stretch_of(camera @ ruler))
        np.testing.assert_allclose(found, pitches(camera), rtol=1e-9)
    np.testing.assert_allclose(found, [0.5, 1 / 2.1, 0.04 / 4.1], rtol=1e-9)


def test_scales_of_axes_and_the_angle_between_them() -> None:
    axes = np.array([[1.01, -0.02], [0.0, 0.98]])
    np.testing.assert_allclose(scales(axes)[:2], [1.01, np.hypot(0.02, 0.98)])
    assert scales(axes)[2] == pytest.approx(-np.arctan(0.02 / 0.98))


def drawn_stops(bend: float, noise: float = 2e-5) -> list[StageStop]:
    """Return stops with the drawing's scale, as a distortion has both."""
    rng, found = np.random.default_rng(5), []

    def seen(place: FloatArray) -> FloatArray:
        now = place.copy()
        for _ in range(30):  # what its straightening takes to the place
            now = place / (1 - bend * (now @ now) / CORNER_PX**2)
        return now

    for stop in stops_at(GRID, MIRRORED, noise_px=0.0):
        place = MIRRORED @ (stop.x_um, stop.y_um)
        steps = [(seen(place + d) - seen(place - d)) / 0.02 for d in 0.01 * np.eye(2)]
        matrix = stretch_of(np.stack(steps, axis=1) @ CAMERA)
        right, up = (seen(place) + rng.normal(0, 0.01, 2)).tolist()
        found.append(
            replace(stop, right_px=right, up_px=up, true_share=noise,
                    stretch=matrix + noise * rng.normal(size=(2, 2)))
        )  # fmt: skip
    return found


CAMERA = stretch_of(MIRRORED)


def test_pitches_by_the_drawing_have_the_distortion_taken_off() -> None:
    """They would be .6 % off: the mean of 1 + 2 r^2 .01 over the stops."""
    fit = fitted(drawn_stops(0.01))
    assert fit.one("distortion") is not None
    true = dict(zip(("drawn_pitch_x", "drawn_pitch_y"), pitches(CAMERA), strict=False))
    for name, value in (*true.items(), ("scale_x", 1.0), ("scale_y", 1.0)):
        one = fit.one(name)
        assert one is not None
        assert one.sigma
        assert abs(one.value - value) < 5 * one.sigma
        assert abs(one.value / value - 1) < 5e-4


def test_stops_without_a_scale_leave_it_to_others() -> None:
    stops = drawn_stops(0.0)
    stops[0] = replace(stops[0], stretch=None)
    one = fitted(stops).one("drawn_pitch_x")
    assert one is not None
    assert one.sigma
    assert abs(one.value - pitches(CAMERA)[0]) < 5 * one.sigma
