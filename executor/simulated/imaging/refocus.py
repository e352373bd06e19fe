"""What defocus does beyond the blur of a plane: light that differs by direction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.executor.simulated.imaging.rays.lattice import PointLattice, lattice_over
from microplan.executor.simulated.imaging.rays.regions import OPEN, PlaneRegion
from microplan.executor.simulated.imaging.sharp_plane import SharpPlane
from microplan.executor.simulated.imaging.solids.solid_scene import MappedBody

EDGE_SHARE = 0.25  # of the blur's radius: how far apart points are near edges
LEAST_UM = 0.4  # apart: the lens' own blur is wider
MOST_UM = 3.0
COARSE = 4  # times that, away from edges
COARSE_PLANE = 1.5  # of the plane's lattice, at least
MOST_LOOKS = 1 << 20  # at once

Chief = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False)
class Refocused:
    """Rays through a plane, gathered in another one."""

    plane: SharpPlane
    chief: Chief
    blur_um: float  # radius of a point's blur
    drop_um: float  # from the focus down to the plane
    crossing: tuple[MappedBody, ...]  # bodies cut by both planes: in focus in both
    aside: FloatArray | None = None  # (directions, 2) um past points; None: 0

    def remainder(self) -> FloatArray:
        """Return what rays see in focus less the plane's own blur.

        On the plane's fine grid, (rows, columns), a step of `step_um` apart.
        """
        crossing = self.crossing
        plane = self.plane
        spacing = float(np.clip(EDGE_SHARE * self.blur_um, LEAST_UM, MOST_UM))
        x, y = plane.x_um, plane.y_um
        box = (float(x[0]), float(y[0]), float(x[-1]), float(y[-1]))
        lattice = lattice_over(box, spacing)
        outer = self._on_fine(PlaneRegion(OPEN, (), crossing), lattice)
        if not crossing:
            return outer
        inside = PlaneRegion(OPEN, crossing, ())
        gx, gy = np.meshgrid(x.astype(np.float32), y.astype(np.float32))
        away = np.min([b.distance(gx, gy, exact=True) for b in crossing], axis=0)
        share = np.clip(0.5 - away / plane.step_um, 0.0, 1.0)
        inner = self._on_fine(inside, lattice)
        mixed: FloatArray = (1 - share) * outer + share * inner
        return mixed

    def _on_fine(self, region: PlaneRegion, lattice: PointLattice) -> FloatArray:
        """Return the remainder in one region of the focal plane, continued beyond."""
        px, py = lattice.points()
        shape = (len(lattice.y_um), len(lattice.x_um))
        reach = region.distance(px, py) < 2 * lattice.spacing_um
        coarse = lattice_over(
            (lattice.x_um[0], lattice.y_um[0], lattice.x_um[-1], lattice.y_um[-1]),
            max(
                COARSE * lattice.spacing_um,
                COARSE_PLANE * self.plane.lattice.spacing_um,
            ),
        )
        # a coarse point near an edge bends what lies between it and the next
        aside_um = 0.0 if self.aside is None else float(np.abs(self.aside).max())
        wide_um = self.blur_um + aside_um + 2 * lattice.spacing_um + coarse.spacing_um
        near = self._near_edges(px, py, wide_um) & reach
        cx, cy = coarse.points()
        base = self._at(*region.drawn_in(cx, cy)[:2]).reshape(
            len(coarse.y_um), len(coarse.x_um)
        )
        values = coarse.smooth(base, lattice.x_um, lattice.y_um).ravel()
        at = np.flatnonzero(near)
        qx, qy, _ = region.drawn_in(px[at], py[at])
        values[at] = self._at(qx, qy)
        return lattice.smooth(values.reshape(shape), self.plane.x_um, self.plane.y_um)

    def _near_edges(self, x: FloatArray, y: FloatArray, wide_um: float) -> BoolArray:
        """Return which points are so near to a border in the plane."""
        cell = self.plane.cell(x.astype(np.float32), y.astype(np.float32))
        away = self.plane.edge_um.ravel().take(cell)
        near: BoolArray = away < wide_um
        return near

    def _at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the remainder at points of the focal plane, (N,)."""
        many = max(1, MOST_LOOKS // len(self.plane.slopes))
        parts = [
            self._some(x[i : i + many], y[i : i + many]) for i in range(0, len(x), many)
        ]
        return np.concatenate(parts) if parts else np.zeros(0)

    def _some(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the remainder at some points."""
        tilt_x, tilt_y = self.chief(x, y)
        drop = np.float32(self.drop_um)
        along = drop * self.plane.slopes.astype(np.float32)
        if self.aside is not None:
            along += self.aside.astype(np.float32)
        qx, qy = (
            (at + self.drop_um * tilt).astype(np.float32)[:, None] + along[:, k]
            for k, (at, tilt) in enumerate(((x, tilt_x), (y, tilt_y)))
        )
        cell = self.plane.cell(qx, qy)
        light = self.plane.towards(qx, qy, cell)
        if self.crossing:
            light += self.plane.cut_step.ravel().take(cell).astype(np.float32)
        mean: FloatArray = light.mean(axis=1, dtype=float)
        return mean
