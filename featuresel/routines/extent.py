"""How far a target reaches, and the piece of an image that holds it."""

from __future__ import annotations

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import Target

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
    """Return the template about the pixel nearest the reference point."""
    column, row = round(target.column), round(target.row)
    return image[
        row - half[1] : row + half[1] + 1, column - half[0] : column + half[0] + 1
    ]
