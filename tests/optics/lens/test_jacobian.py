"""The image Jacobian by finite differences through the renderer."""

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.optics.lens.jacobian import point_jacobian, to_px
from microplan.optics.render.render import render
from microplan.optics.transfer.microscope import Microscope
from tests.optics.shapes import disc, microscope, one_layer

AXIS_UM = (-900.0, 700.0)  # far outside the field, as a stage's axis is
SPOT_UM = (22.0, -13.0)


def _centroid(center: tuple[float, float], optics: Microscope) -> FloatArray:
    """Return (column, row) of a rendered disc's light."""
    image = render(one_layer(disc(5.0, center), 6.0), optics, focus_um=0.0)
    row, column = np.mgrid[: optics.height_px, : optics.width_px]
    weight = image.sum()
    return np.array([(image * column).sum() / weight, (image * row).sum() / weight])


def _turned(point: tuple[float, float], angle: float) -> tuple[float, float]:
    x, y = point[0] - AXIS_UM[0], point[1] - AXIS_UM[1]
    c, s = math.cos(angle), math.sin(angle)
    return (AXIS_UM[0] + c * x - s * y, AXIS_UM[1] + s * x + c * y)


def _moved(column: int, step: float, optics: Microscope) -> FloatArray:
    """Return where the disc appears after a move along one column of the Jacobian."""
    x, y = SPOT_UM
    if column == 2:
        return _centroid(_turned(SPOT_UM, step), optics)
    if column == 3:
        zoomed = replace(optics, magnification=optics.magnification * (1 + step))
        return _centroid(SPOT_UM, zoomed)
    moved = (x + step, y) if column == 0 else (x, y + step)
    return _centroid(moved, optics)


@pytest.mark.parametrize(("column", "step"), [(0, 0.5), (1, 0.5), (2, 5e-4), (3, 5e-3)])
def test_points_move_as_the_renderer_says(column: int, step: float) -> None:
    # The centroid feels the tails that leave the frame: 1 % of a pixel a pixel.
    # A rotation column without the sign, or about the image's centre, is off by 100 %.
    optics = microscope()
    at = to_px(np.array([SPOT_UM]), optics)
    predicted = point_jacobian(at, optics, axis_um=AXIS_UM)[:, column]
    ahead, behind = (_moved(column, s, optics) for s in (step, -step))
    measured = (ahead - behind) / (2 * step)
    np.testing.assert_allclose(
        measured, predicted, rtol=0, atol=0.02 * np.abs(predicted).max()
    )


def _moment(z_um: float, optics: Microscope) -> float:
    """Return the mean square radius of a spot's image within 40 um, px2."""
    image = render(one_layer(disc(1.0), z_um), optics, focus_um=0.0)
    row, column = np.mgrid[: optics.height_px, : optics.width_px]
    y, x = row - (optics.height_px - 1) / 2, column - (optics.width_px - 1) / 2
    weight = image * (np.hypot(x, y) < 40 * optics.px_per_um)
    return float((weight * (x**2 + y**2)).sum() / weight.sum())


def _blur(z_um: float, optics: Microscope) -> float:
    """Return the diameter of the uniform circle with the image's mean square, px."""
    return math.sqrt(8 * (_moment(z_um, optics) - _moment(0.0, optics)))


@pytest.mark.parametrize("z_um", [30.0, -30.0])
def test_blur_grows_with_the_defocus_and_its_sign(z_um: float) -> None:
    # A quadratic phase draws the circle 4 |W20| / A, not the marginal ray's. Its
    # spread beyond the circle moves the mean square by a wave or two in w = 4.6.
    optics = microscope()
    measured = (_blur(z_um + 4.0, optics) - _blur(z_um - 4.0, optics)) / 8.0
    predicted = math.copysign(optics.px_per_um * optics.blur_diameter_um(1.0), z_um)
    drawn = 4 * optics.rim_w20_um(1.0) / optics.aperture / optics.blur_diameter_um(1.0)
    assert drawn == pytest.approx(0.952, abs=1e-3)
    assert measured == pytest.approx(predicted * drawn, rel=0.03)


def test_a_pair_on_a_row_solves_its_rotation() -> None:
    # With the paper's rotation column this very pair ran away in theta.
    optics = microscope()
    world = np.array([[-30.0, 2.0], [30.0, 2.0]])
    turn = 0.01
    c, s = math.cos(turn), math.sin(turn)
    after = world @ np.array([[c, s], [-s, c]]) + np.array([0.4, -0.7])
    change = (to_px(after, optics) - to_px(world, optics)).ravel()
    jacobian = point_jacobian(to_px(world, optics), optics)[:, :3]
    x, y, theta = np.linalg.lstsq(jacobian, change, rcond=None)[0]
    # second order: theta**2 / 2 x 30 um = 1.5 nm
    assert theta == pytest.approx(turn, abs=2e-5)
    assert x == pytest.approx(0.4, abs=2e-3)
    assert y == pytest.approx(-0.7, abs=2e-3)


def test_what_does_not_fit_is_refused() -> None:
    optics = microscope()
    with pytest.raises(ValueError, match=r"points_px must be \(N, 2\)"):
        point_jacobian(np.zeros(3), optics)
    with pytest.raises(ValueError, match="finite"):
        point_jacobian(np.array([[math.nan, 0.0]]), optics)
