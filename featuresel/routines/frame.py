"""Pixels of a region to um in the world frame and back, at one magnification."""

from __future__ import annotations

from dataclasses import dataclass


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
