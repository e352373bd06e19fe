"""Images of a region: what a routine accepts, its pixels in um, a target's extent."""

from __future__ import annotations

from dataclasses import dataclass

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import Failure, Target


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionFrame:
    """A region of a `width_px` x `height_px` frame whose centre is the optical axis."""

    width_px: int
    height_px: int
    um_per_px: float
    row: int = 0  # of the region's top left pixel in the frame
    column: int = 0

    def to_world(self, column: float, row: float) -> tuple[float, float]:
        """Return (x, y) um of a pixel of the region."""
        x_px = column + self.column - (self.width_px - 1) / 2
        y_px = (self.height_px - 1) / 2 - (row + self.row)
        return (x_px * self.um_per_px, y_px * self.um_per_px)

    def to_pixel(self, x_um: float, y_um: float) -> tuple[float, float]:
        """Return (column, row) of the region for a world point."""
        column = (self.width_px - 1) / 2 + x_um / self.um_per_px - self.column
        row = (self.height_px - 1) / 2 - y_um / self.um_per_px - self.row
        return (column, row)


_MARGIN_PX = 4.0  # around the target, so that its edge is in the template


def half_px(target: Target, shape: tuple[int, ...], room_px: float) -> tuple[int, int]:
    """Return half a template's sides (columns, rows), px.

    It holds the target and a margin, but stays in an image of `shape` with `room_px`
    to spare; negative where that cannot be.
    """
    p, k = target.parameters, target.px_per_um
    if target.kind == "jaws":
        wide = p["opening_um"] / 2 + 0.3 * p["finger_width_um"]
        want = (wide * k, p["grip_from_tip_um"] * 1.5 * k)
    else:
        names = ("radius_um", "outer_um", "extent_um")
        extent = next(p[name] for name in names if name in p)
        want = (extent * k, extent * k)
    column, row = round(target.column), round(target.row)
    room = room_px + 2
    free = (
        min(column, shape[1] - 1 - column) - room,
        min(row, shape[0] - 1 - row) - room,
    )
    return (
        int(min(want[0] + _MARGIN_PX, free[0])),
        int(min(want[1] + _MARGIN_PX, free[1])),
    )


def cut(image: FloatArray, target: Target, half: tuple[int, int]) -> FloatArray:
    """Return the template, (2 R + 1, 2 C + 1) px, about the reference point's pixel."""
    column, row = round(target.column), round(target.row)
    return image[
        row - half[1] : row + half[1] + 1, column - half[0] : column + half[0] + 1
    ]


# Full scale is 1, and no correction of dark or uneven light comes near this. Squares of
# it, summed over any frame, are still far from the end of single precision.
_MOST = 1e3


def refused(image: FloatArray) -> Failure | None:
    """Return why no routine can look at `image`, None if one can.

    Parameters
    ----------
    image : (rows, columns) float array
        0..1 of full scale, or a little beyond.

    Returns
    -------
    Failure or None
        "no_image" of what has no pixels, or one that is not a number near that range:
        sums over it would be endless, or nan, and would raise or compare as anything.
    """
    if image.ndim != 2 or image.size == 0:
        return Failure("no_image", f"an image of shape {image.shape}")
    low, high = float(image.min()), float(image.max())  # nan if a pixel is
    if low >= -_MOST and high <= _MOST:
        return None
    return Failure("no_image", f"pixels from {low:.3g} to {high:.3g}, full scale is 1")
