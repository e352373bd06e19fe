"""What keeps pictures of a point from telling a lens."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from microplan.arrays import FloatArray
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.calibration.estimates import FEWEST_BLOCKS
from microplan.planner.calibration.through_focus.focus_fit import FEWEST_ASIDE
from microplan.planner.calibration.through_focus.point_picture import PointPicture

LEAST_PX = 12  # from a point to each border of its picture
NEAR_PX = 8.0  # to a point from where it is said to be
CLEAR = 10.0  # deviations of the picture by which a point is brighter
# Coarser pixels fold frequencies back. A tenth beyond the cut-off's carries next to
# nothing: twins' lenses come out as of finer pixels.
_FOLDED = 1.1
# Of the peak, a wavelength over the aperture away, falling as the distance's cube:
# rings of lenses of .12 waves stay below it (twins). Another point of .02 moves the
# aperture by .2 %.
_RING, _LEAST = 1.0, 0.02


def deviation(light: FloatArray, least: float) -> float:
    """Return how far a picture is usually off its median, `least` or more.

    Parameters
    ----------
    light : (rows, columns) float array
        Less its median; or counts.
    least : float
        What a count is.
    """
    return max(float(np.median(np.abs(light))), least)


def why_coarse(scope: Microscope, aperture: float) -> tuple[str, str] | None:
    """Return why pixels are too large for an aperture, and what to do; None if not."""
    most_um, now_um = scope.wavelength_um / (4 * aperture), scope.um_per_px
    if now_um <= _FOLDED * most_um:
        return None
    needed = math.ceil(10 * scope.magnification * now_um / most_um) / 10
    why = f"a pixel is {now_um:.3g} um, the image of a point at the aperture "
    why += f"{aperture:.3g} asks for {most_um:.3g} um"
    return why, f"photograph the bead at {needed:g} x or more, or with smaller pixels"


def sharpest(pictures: Sequence[PointPicture]) -> PointPicture:
    """Return the picture with the brightest pixel over the usual one."""
    return max(pictures, key=lambda each: float(_over(each).max()))


def why_unfit(pictures: Sequence[PointPicture], count: float) -> str:
    """Return why pictures tell no lens, "" if they may.

    Parameters
    ----------
    pictures : sequence of PointPicture
        All readings.
    count : float
        The light of a count.
    """
    readings = {each.z_um for each in pictures}
    if len(readings) < FEWEST_BLOCKS:
        return f"{len(readings)} focus readings, {FEWEST_BLOCKS} are needed"
    if _border_px(pictures[0]) < LEAST_PX:
        return f"the point is nearer to the border than {LEAST_PX} px"
    best = sharpest(pictures)
    sides = [sum((z - best.z_um) * side > 0 for z in readings) for side in (-1, 1)]
    if min(sides) < FEWEST_ASIDE:
        return f"{sides[0]} readings below the sharpest, {sides[1]} above it"
    return _other_point(best, count)


def _over(picture: PointPicture) -> FloatArray:
    """Return the light over the usual one, (rows, columns)."""
    found: FloatArray = picture.shown - np.median(picture.shown)
    return found


def _border_px(picture: PointPicture) -> float:
    """Return how far the point is from the nearest border."""
    rows, columns = picture.shown.shape
    right, down = picture.seen_px
    return float(min(right, columns - 1 - right, down, rows - 1 - down))


def _other_point(picture: PointPicture, count: float) -> str:
    """Return where there is a point that is not the one's own ring, "" if nowhere."""
    light, scope = _over(picture), picture.scope
    near = _distances(light.shape, picture.seen_px) <= NEAR_PX
    row, column = divmod(int(np.argmax(np.where(near, light, -np.inf))), light.shape[1])
    peak = max(float(light[row, column]), count)
    far_px = _distances(light.shape, (column, row))
    across = np.maximum(far_px, 0.5) * scope.um_per_px
    across *= scope.aperture / scope.wavelength_um
    own = np.maximum(_RING / across**3, _LEAST) * peak
    most = np.maximum(own, CLEAR * deviation(light, count))
    other = (light == ndimage.maximum_filter(light, 3)) & (light > most)
    other[row, column] = False
    if not other.any():
        return ""
    at = int(np.argmax(np.where(other, light, -np.inf)))
    percent = 100 * float(light.flat[at]) / peak
    return f"a point {far_px.flat[at]:.0f} px away is {percent:.0f} % as bright"


def _distances(shape: tuple[int, ...], at_px: tuple[float, float]) -> FloatArray:
    """Return how far pixels (rows, columns) are from a column and row."""
    row, column = np.indices(shape)
    found: FloatArray = np.hypot(column - at_px[0], row - at_px[1])
    return found
