"""What a finite tile costs: light of repetitions, and light that is cut off.

Far from an edge the image of a point falls like K / r**3, in focus and out of it, since
the transfer starts with a kink of slope -4 / pi in x whatever the defocus. That gives
K = wavelength / (2 pi**3 A), and 2 K / d for an endless half plane d away.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from optics.clip import Box, clip
from optics.microscope import Microscope
from optics.outline import Outline
from optics.pixels import PixelTile, axis_px, choose_tile
from optics.scene import Window

FloatArray = npt.NDArray[np.float64]

MARGINS: FloatArray = np.geomspace(5.0, 160.0, 21)  # wavelengths / A worth choosing
_DOUBLINGS = 12  # of the margin, in the search for the nearest edge
_RINGS = 3  # of repetitions that are summed one by one
# The others: the sum of (i**2 + j**2)**-1.5 over all i, j but 0, 0 is 9.034, over the
# first three rings 7.49; the pixel need not be in the middle, hence twice the rest.
_BEYOND = 2 * (9.034 - 7.49)


def wrap_error(
    outline: Outline,
    microscope: Microscope,
    margin: float,
    window: Window | None = None,
) -> float:
    """Return a bound of what a tile with a margin costs one layer.

    Parameters
    ----------
    outline : Outline
        The layer's outline, world frame.
    microscope : Microscope
        The optical setting.
    margin : float
        Distance to repetitions and to cuts beyond the blur, in wavelengths / A.
    window : Window, optional
        The part of the frame that is seen; default all.

    Returns
    -------
    float
        Of unit contrast. 0 where nothing of the outline comes near.
    """
    if not outline.rings:
        return 0.0
    frame = window or _full(microscope)
    unit = microscope.wavelength_um / microscope.aperture
    d = margin * unit
    tile = choose_tile(outline, microscope, d, frame, (0.0, 0.0))
    if tile is None:
        return _outside(outline, _frame_box(microscope, frame), unit)
    seen = _seen_box(microscope, tile)
    for _ in range(_DOUBLINGS):  # what is cut off begins at the first edge
        if not _is_even(outline, _grown(seen, d)):
            break
        d *= 2
    cut = tile.columns.cut is not None or tile.rows.cut is not None
    found = _beyond(outline, seen, unit, d)
    if not cut:
        found = min(found, _repeated(outline, microscope, tile, unit))
    return min(found, 1.0)


def margin_for(
    outline: Outline,
    microscope: Microscope,
    error: float,
    window: Window | None = None,
) -> float:
    """Return the least of `MARGINS` that costs `error` at most, else the last."""
    for margin in MARGINS:
        if wrap_error(outline, microscope, float(margin), window) <= error:
            return float(margin)
    return float(MARGINS[-1])


def _repeated(
    outline: Outline, microscope: Microscope, tile: PixelTile, unit_um: float
) -> float:
    """Return what the repetitions of a whole part cost the worst corner seen."""
    x_min, y_min, x_max, y_max = outline.bounds_um
    radius = math.hypot(x_max - x_min, y_max - y_min) / 2
    x0, y0, x1, y1 = _seen_box(microscope, tile)
    middle = np.array([(x_min + x_max) / 2, (y_min + y_max) / 2])
    corners = np.array([(x, y) for x in (x0, x1) for y in (y0, y1)]) - middle
    period = microscope.um_per_px * np.array([tile.columns.count, tile.rows.count])
    i, j = np.mgrid[-_RINGS : _RINGS + 1, -_RINGS : _RINGS + 1].reshape(2, -1)
    others = np.column_stack([i, j])[(i != 0) | (j != 0)] * period
    far = np.hypot(*np.moveaxis(corners[:, None] - others, -1, 0))
    if not far.min() > radius:
        return math.inf
    # the mean of r**-3 over a disc `far` away; the part lies in that disc
    close = (far**-3 * (1 - (radius / far) ** 2) ** -1.5).sum(axis=1).max()
    return float(
        unit_um
        / (2 * math.pi**3)
        * outline.area_um2
        * (close + _BEYOND / period.min() ** 3)
    )


def _beyond(outline: Outline, seen: Box, unit_um: float, d_um: float) -> float:
    """Return what lacks, or comes in, beyond all four sides of what is seen.

    A strip b wide that begins `far` away costs K b / (2 far**2) at most, and never
    more than a half plane, 2 K / far. A pixel in a corner has two sides near.
    """
    x_min, y_min, x_max, y_max = outline.bounds_um
    wide = min(x_max, seen[2] + d_um) - max(x_min, seen[0] - d_um)
    high = min(y_max, seen[3] + d_um) - max(y_min, seen[1] - d_um)
    sides = (
        (wide, d_um),
        (high, d_um),
        (wide, d_um + seen[3] - seen[1]),
        (high, d_um + seen[2] - seen[0]),
    )
    strips = (min(2 / far, b / (2 * far**2)) for b, far in sides)
    return unit_um / (2 * math.pi**3) * sum(strips)


def _outside(outline: Outline, frame: Box, unit_um: float) -> float:
    """Return what a body costs that is left out since it lies too far outside."""
    x_min, y_min, x_max, y_max = outline.bounds_um
    dx = max(x_min - frame[2], frame[0] - x_max, 0.0)
    dy = max(y_min - frame[3], frame[1] - y_max, 0.0)
    far = math.hypot(dx, dy)
    return unit_um / (2 * math.pi**3) * min(2 / far, outline.area_um2 / far**3)


def _is_even(outline: Outline, box: Box) -> bool:
    """Tell whether a box is covered, or empty."""
    edges = clip(outline, box)
    if not len(edges.segments) and not len(edges.arcs):
        return True
    share = edges.area_um2 / ((box[2] - box[0]) * (box[3] - box[1]))
    return abs(share) < 1e-12 or abs(share - 1) < 1e-12


def _full(microscope: Microscope) -> Window:
    return Window(
        row=0, column=0, rows=microscope.height_px, columns=microscope.width_px
    )


def _seen_box(microscope: Microscope, tile: PixelTile) -> Box:
    """Return the box of the centres of pixels seen."""
    columns, rows = tile.columns.seen, tile.rows.seen
    return _box(microscope, columns[0], columns[-1], rows[0], rows[-1])


def _frame_box(microscope: Microscope, frame: Window) -> Box:
    """Return the box of the centres of a window's pixels."""
    right, below = frame.column + frame.columns - 1, frame.row + frame.rows - 1
    return _box(microscope, frame.column, right, frame.row, below)


def _box(microscope: Microscope, left: int, right: int, above: int, below: int) -> Box:
    """Return pixels' centres as (x_min, y_min, x_max, y_max), um."""
    cx, cy = axis_px(microscope)
    p = microscope.um_per_px
    return ((left - cx) * p, (cy - below) * p, (right - cx) * p, (cy - above) * p)


def _grown(box: Box, by_um: float) -> Box:
    return (box[0] - by_um, box[1] - by_um, box[2] + by_um, box[3] + by_um)
