"""Flat bodies as polygons, how much of each pixel they cover, and shapes to use.

Pixel (r, c) has its centre at x = (c - (columns - 1) / 2) um_per_px and
y = -(r - (rows - 1) / 2) um_per_px; y is up.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import shapely
from ezdxf.filemanagement import new
from shapely import affinity
from shapely.geometry import MultiPolygon, Point, Polygon, box
from shapely.ops import unary_union

Floats = npt.NDArray[np.float64]
Shape = Polygon | MultiPolygon

_MICRONS = 13  # $INSUNITS
_LEAST_FINER = 8  # points a side of a pixel


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """A flat body: where it lies (um), how much light it returns, and its height."""

    shape: Shape
    reflectance: float
    z_um: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """Bodies that do not overlap, before a background without an edge."""

    bodies: tuple[Body, ...]
    background: float  # reflectance


def placed(shape: Shape, x_um: float, y_um: float, theta_rad: float) -> Shape:
    """Return a shape turned about its own origin, then moved."""
    turned = affinity.rotate(shape, theta_rad, origin=(0, 0), use_radians=True)
    return affinity.translate(turned, x_um, y_um)


def axes_um(size: tuple[int, int], um_per_px: float) -> tuple[Floats, Floats]:
    """Return x (columns,) and y (rows,) of the centres of pixels."""
    rows, columns = size
    x = (np.arange(columns, dtype=np.float64) - (columns - 1) / 2) * um_per_px
    y = ((rows - 1) / 2 - np.arange(rows, dtype=np.float64)) * um_per_px
    return x, y


def coverage(
    shape: Shape, size: tuple[int, int], um_per_px: float, finer: int = 16
) -> Floats:
    """Return the share of each pixel that a shape covers, (rows, columns), 0..1.

    Pixels near an edge are sampled at finer x finer points; others are whole.
    """
    if finer < _LEAST_FINER:
        raise ValueError(f"finer is {finer}, and must be {_LEAST_FINER} at least")
    x, y = axes_um(size, um_per_px)
    shapely.prepare(shape)
    near = _near_edges(shape, size, um_per_px)
    found = _whole(shape, near, x, y)
    row, column = np.nonzero(near)
    offset = ((np.arange(finer) + 0.5) / finer - 0.5) * um_per_px
    at_x = x[column][:, None, None] + offset[None, None, :]
    at_y = y[row][:, None, None] + offset[None, :, None]
    inside = shapely.contains_xy(shape, *np.broadcast_arrays(at_x, at_y))
    found[row, column] = inside.mean(axis=(1, 2))
    return found


def _whole(shape: Shape, near: npt.NDArray[np.bool_], x: Floats, y: Floats) -> Floats:
    """Return 1 or 0 for pixels (rows, columns) that no edge is near to.

    Of pixels side by side, without one near an edge between them, the first is asked.
    """
    before = np.pad(near, ((0, 0), (1, 0)), constant_values=True)[:, :-1]
    first = ~near & before
    row, column = np.nonzero(first)
    inside = np.zeros(near.shape)
    inside[row, column] = shapely.contains_xy(shape, x[column], y[row])
    asked = np.where(first | near, np.arange(x.size), 0)
    asked = np.maximum.accumulate(asked, axis=1)
    return np.take_along_axis(inside, asked, axis=1)


def _near_edges(
    shape: Shape, size: tuple[int, int], um_per_px: float
) -> npt.NDArray[np.bool_]:
    """Return which pixels an edge crosses, and their neighbours, (rows, columns)."""
    rows, columns = size
    points = shapely.get_coordinates(shapely.segmentize(shape.boundary, um_per_px / 2))
    column = np.rint(points[:, 0] / um_per_px + (columns - 1) / 2).astype(int)
    row = np.rint((rows - 1) / 2 - points[:, 1] / um_per_px).astype(int)
    found = np.zeros((rows + 4, columns + 4), dtype=np.bool_)  # two pixels around
    here = (row >= -1) & (row <= rows) & (column >= -1) & (column <= columns)
    for down in (-1, 0, 1):
        for across in (-1, 0, 1):
            found[row[here] + 2 + down, column[here] + 2 + across] = True
    return found[2:-2, 2:-2]


def dot(radius_um: float, corners: int = 720) -> Polygon:
    """Return a disc of the circle's own area, as a regular polygon."""
    angle = np.arange(corners) * 2 * np.pi / corners
    full = radius_um / np.sqrt(np.sinc(2 / corners))
    return Polygon(full * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def ring(outer_um: float, inner_um: float) -> Polygon:
    """Return what lies between two circles, by their radii."""
    return Polygon(dot(outer_um).exterior, [dot(inner_um).exterior])


def gear(
    tip_um: float, root_um: float, bore_um: float = 0.0, teeth: int = 18
) -> Polygon:
    """Return a gear with straight flanks, one tooth along +x, by its radii."""
    pitch = 2 * np.pi / teeth
    corners = [(-0.32, root_um), (-0.18, tip_um), (0.18, tip_um), (0.32, root_um)]
    outline = [
        (radius * np.cos((tooth + at) * pitch), radius * np.sin((tooth + at) * pitch))
        for tooth in range(teeth)
        for at, radius in corners
    ]
    return Polygon(outline, [dot(bore_um).exterior] if bore_um > 0 else [])


def square_with_notch(side_um: float, notch_um: float) -> Polygon:
    """Return a square without its corner at +x +y: no turn leaves it as it was."""
    half, inner = side_um / 2, side_um / 2 - notch_um
    return Polygon(
        [(-half, -half), (half, -half), (half, inner), (inner, inner), (inner, half),
         (-half, half)]
    )  # fmt: skip


def cross(length_um: float, width_um: float) -> Polygon:
    """Return two bars across each other, by their length and width."""
    a, b = length_um / 2, width_um / 2
    found = unary_union([box(-a, -b, a, b), box(-b, -a, b, a)])
    if not isinstance(found, Polygon):
        raise TypeError("the bars of a cross make one polygon")
    return found


def slot(length_um: float, width_um: float) -> Polygon:
    """Return a bar along x with round ends, `length_um` from end to end."""
    half = (length_um - width_um) / 2
    if half < 0:
        raise ValueError("a slot is no shorter than it is wide")
    ends = [Point(-half, 0), Point(half, 0)]
    return shapely.MultiPoint(ends).convex_hull.buffer(width_um / 2, quad_segs=180)


def write_dxf(shape: Shape, file: Path, layer: str) -> None:
    """Write a shape's rings, holes too, as closed LWPOLYLINEs in um."""
    document = new("R2010")
    document.header["$INSUNITS"] = _MICRONS
    if layer not in document.layers:
        document.layers.add(layer)
    space = document.modelspace()
    for part in shapely.get_parts(shape):
        for each in (part.exterior, *part.interiors):
            corners = [(float(x), float(y)) for x, y in each.coords[:-1]]
            space.add_lwpolyline(corners, close=True, dxfattribs={"layer": layer})
    document.saveas(file)
