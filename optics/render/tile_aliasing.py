"""Error of a finite tile: light of repetitions, light cut off.

Far from an edge the image of a point falls like K / r**3, in focus and out of it, since
the transfer starts with a kink of slope -4 / pi in x whatever the defocus. That gives
K = wavelength / (2 pi**3 A), and 2 K / d for an endless half plane d away.
"""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import Box, FloatArray
from microplan.optics.outline.clip import clip, common, grown
from microplan.optics.outline.outline import Outline
from microplan.optics.render.pixels import PixelTile, axis_px, choose_tile
from microplan.optics.render.scene import Window
from microplan.optics.render.view_range import full
from microplan.optics.transfer.microscope import Microscope

MARGINS: FloatArray = np.geomspace(5.0, 160.0, 21)  # wavelengths / A worth choosing
_DOUBLINGS = 12  # of the margin, in the search for the nearest edge
_HALVINGS = 4  # of the last doubling
_PLANE: Box = (-math.inf, -math.inf, math.inf, math.inf)
_RINGS = 3  # of repetitions that are summed one by one
# The others: the sum of (i**2 + j**2)**-1.5 over all i, j but 0, 0 is 9.034, over the
# first three rings 7.49; the pixel need not be in the middle, hence twice the rest.
_BEYOND = 2 * (9.034 - 7.49)


def wrap_error(
    outline: Outline,
    microscope: Microscope,
    margin: float,
    window: Window | None = None,
    *,
    blur_um: float = 0.0,
) -> float:
    """Return a bound of what a tile with a margin costs one layer.

    Parameters
    ----------
    outline : Outline
        The layer's outline, world frame.
    margin : float
        Distance to repetitions and to cuts beyond the blur, in wavelengths / A.
    window : Window, optional
        The part of the frame that is seen; default all.
    blur_um : float
        Radius of the blur circle, beyond which light falls off.

    Returns
    -------
    float
        Of unit contrast. 0 where nothing of the outline comes near.
    """
    if not outline.rings:
        return 0.0
    frame = window or full(microscope)
    unit = microscope.wavelength_um / microscope.aperture
    d = margin * unit
    tile = choose_tile(outline, microscope, d, frame, (0.0, 0.0))
    if tile is None:
        return _outside(outline, _frame_box(microscope, frame), unit, blur_um, d)
    seen = _seen_box(microscope, tile)
    covered = _covered(outline, grown(seen, d))
    if covered is None:
        found = _cut_or_repeated(outline, microscope, tile, d)
    else:  # what is cut off begins at the first edge
        bounds = _PLANE if covered else outline.bounds_um
        nearest_um = _nearest_um(outline, seen, d) - blur_um
        found = _beyond(bounds, seen, max(nearest_um, d))
    return min(unit / (2 * math.pi**3) * found, 1.0)


def margin_for(
    outline: Outline,
    microscope: Microscope,
    error: float,
    window: Window | None = None,
    *,
    blur_um: float = 0.0,
) -> float:
    """Return the least of `MARGINS` that costs `error` at most, else the last."""
    for margin in MARGINS:
        found = wrap_error(outline, microscope, float(margin), window, blur_um=blur_um)
        if found <= error:
            return float(margin)
    return float(MARGINS[-1])


def _cut_or_repeated(
    outline: Outline, microscope: Microscope, tile: PixelTile, d_um: float
) -> float:
    """Return what lacks beyond a tile or comes in by repetition, the larger, over K.

    Light that lacks and light that comes in have opposite signs.
    """
    seen = _seen_box(microscope, tile)
    bounds = outline.bounds_um
    is_whole = common(bounds, grown(seen, d_um)) == bounds
    lacks = 0.0 if is_whole else _beyond(bounds, seen, d_um)
    comes = min(_repeated(outline, microscope, tile, d_um), _beyond(_PLANE, seen, d_um))
    return max(lacks, comes)


def _repeated(
    outline: Outline, microscope: Microscope, tile: PixelTile, d_um: float
) -> float:
    """Return what the repetitions of what a tile holds cost the worst corner, over K.

    Infinite where they are too close together for this bound.
    """
    seen = _seen_box(microscope, tile)
    held = common(outline.bounds_um, grown(seen, d_um))
    area_um2 = clip(outline, held).area_um2
    radius = math.hypot(held[2] - held[0], held[3] - held[1]) / 2
    x0, y0, x1, y1 = seen
    middle = np.array([(held[0] + held[2]) / 2, (held[1] + held[3]) / 2])
    corners = np.array([(x, y) for x in (x0, x1) for y in (y0, y1)]) - middle
    period = microscope.um_per_px * np.array([tile.columns.count, tile.rows.count])
    i, j = np.mgrid[-_RINGS : _RINGS + 1, -_RINGS : _RINGS + 1].reshape(2, -1)
    others = np.column_stack([i, j])[(i != 0) | (j != 0)] * period
    far = np.hypot(*np.moveaxis(corners[:, None] - others, -1, 0))
    if not far.min() > radius:
        return math.inf
    # the mean of r**-3 over a disc `far` away; what is held lies in that disc
    close = (far**-3 * (1 - (radius / far) ** 2) ** -1.5).sum(axis=1).max()
    return float(area_um2 * (close + _BEYOND / period.min() ** 3))


def _nearest_um(outline: Outline, seen: Box, d_um: float) -> float:
    """Return a distance to which all around the box seen is as even as within `d_um`.

    Half of the distance of the first edge at least, and most often near it.
    """
    for _ in range(_DOUBLINGS):
        if _covered(outline, grown(seen, 2 * d_um)) is None:
            break
        d_um *= 2
    low, high = d_um, 2 * d_um
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if _covered(outline, grown(seen, middle)) is None:
            high = middle
        else:
            low = middle
    return low


def _beyond(bounds: Box, seen: Box, d_um: float) -> float:
    """Return what light beyond all four sides of what is seen amounts to, over K.

    A strip b wide that begins `far` away has b / (2 far**2) at most, and never more
    than a half plane, 2 / far. A pixel in a corner has two sides near. Two opposite
    sides take in the corners beyond, whichever two have less.
    """
    near = common(bounds, grown(seen, d_um))
    sizes = (seen[2] - seen[0], seen[3] - seen[1])
    whole = (bounds[2] - bounds[0], bounds[3] - bounds[1])
    between = (near[2] - near[0], near[3] - near[1])

    def pair(across: float, size: float) -> float:
        """Return what lies beyond two opposite sides, strips `across` wide."""
        return sum(min(2 / far, across / (2 * far**2)) for far in (d_um, d_um + size))

    return min(
        pair(whole[1], sizes[0]) + pair(between[0], sizes[1]),
        pair(between[1], sizes[0]) + pair(whole[0], sizes[1]),
    )


def _outside(
    outline: Outline, frame: Box, unit_um: float, blur_um: float, d_um: float
) -> float:
    """Return what a body costs that is left out since it lies too far outside."""
    x_min, y_min, x_max, y_max = outline.bounds_um
    dx = max(x_min - frame[2], frame[0] - x_max, 0.0)
    dy = max(y_min - frame[3], frame[1] - y_max, 0.0)
    far = max(math.hypot(dx, dy) - blur_um, d_um)
    return unit_um / (2 * math.pi**3) * min(2 / far, outline.area_um2 / far**3)


def _covered(outline: Outline, box: Box) -> bool | None:
    """Tell whether a box is covered or empty, None where it is neither."""
    edges = clip(outline, box)
    if not len(edges.segments) and not len(edges.arcs):
        return False
    share = edges.area_um2 / ((box[2] - box[0]) * (box[3] - box[1]))
    if abs(share) < 1e-12:
        return False
    return True if abs(share - 1) < 1e-12 else None


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
