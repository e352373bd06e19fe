"""Errors of both roads at single points of a look, against waves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.truth.compiler_side import (
    edge_points,
    expected_errors,
    trial_image,
)
from benchmarks.truth.judged_looks import JudgedLook, cell_image
from benchmarks.truth.waves import wave_scene
from microplan.arrays import BoolArray, FloatArray, IntArray
from microplan.executor.simulated.imaging.imaging_view import ImagingView, PixelWindow

POINT = 1e-6  # share of a pixel that sees light: waves are taken at points
REACH_PX = 40.0  # points lie so far from the region's middle, at most
SHARE = 0.1  # of pixels, or of edges, where more errors are looked for


@dataclass(frozen=True, slots=True, kw_only=True)
class WaveErrors:
    """Both roads less the waves, (N,) shares of full scale."""

    compiler: FloatArray
    cell: FloatArray

    @property
    def compiler_max(self) -> float:
        """Return the compiler's largest error."""
        return float(np.abs(self.compiler).max())


def wave_errors(look: JudgedLook, points: int) -> WaveErrors:
    """Return the errors at pixels drawn round the middle of a look's region.

    A third each of all there, of the tenth where the compiler's picture changes most
    from pixel to pixel, and of the tenth of edges at which its ledger expects most.
    """
    scope, view = look.trial.case.microscope, look.cell.view
    case = replace(look.trial.case, microscope=replace(scope, fill_factor=POINT))
    cell = replace(look.cell, view=replace(view, fill_factor=POINT))
    pictures = trial_image(case), cell_image(cell)
    pixels = _Pixels(window=look.cell.window, view=view)
    row, column = _drawn(look, pixels, pictures[0], points)
    scene = wave_scene(
        cell.scene, cell.view, pixels.world(*pixels.middle),
        (pixels.reach + 1) / view.px_per_um,
    )  # fmt: skip
    truth = np.array(
        [scene.image(*pixels.world(r, c)) for r, c in zip(row, column, strict=True)]
    )
    errors = [picture[row, column] - truth for picture in pictures]
    return WaveErrors(compiler=errors[0], cell=errors[1])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pixels:
    """A region's pixels in the world."""

    window: PixelWindow
    view: ImagingView

    @property
    def middle(self) -> tuple[float, float]:
        """Return the row and the column in the region's middle."""
        return (self.window.rows - 1) / 2, (self.window.columns - 1) / 2

    @property
    def reach(self) -> float:
        """Return how far from there pixels are drawn."""
        return min(REACH_PX, *self.middle)

    def world(self, row: float, column: float) -> tuple[float, float]:
        """Return where a pixel looks, um."""
        view, window = self.view, self.window
        x = (window.column + column - (view.width_px - 1) / 2) / view.px_per_um
        y = ((view.height_px - 1) / 2 - window.row - row) / view.px_per_um
        return x, y

    def near(self, at_um: FloatArray) -> IntArray:
        """Return the rows and columns nearest to world points, (N, 2)."""
        view, window = self.view, self.window
        x, y = at_um.T * view.px_per_um
        column = x + (view.width_px - 1) / 2 - window.column
        row = (view.height_px - 1) / 2 - window.row - y
        found: IntArray = np.round(np.stack([row, column], axis=1)).astype(np.intp)
        return found

    def within(self, at: IntArray) -> BoolArray:
        """Return whether rows and columns, (..., 2), are within reach."""
        found: BoolArray = self.reach >= np.hypot(*(at - np.array(self.middle)).T).T
        return found


def _drawn(
    look: JudgedLook, pixels: _Pixels, picture: FloatArray, count: int
) -> tuple[IntArray, IntArray]:
    """Return rows and columns, (count,) each."""
    rng = np.random.default_rng(count)
    every = np.argwhere(np.isfinite(picture))
    near = every[pixels.within(every)]
    steep = np.hypot(*np.gradient(picture))[tuple(near.T)]
    expected = _expected(look, pixels)
    size = count // 3
    parts = [_most(near, steep), expected if len(expected) >= size else near]
    found = [rng.choice(near, count - 2 * size, replace=False)]
    found += [rng.choice(part, size, replace=False) for part in parts]
    row, column = np.concatenate(found).T
    return row, column


def _expected(look: JudgedLook, pixels: _Pixels) -> IntArray:
    """Return the pixels within reach at which the ledger expects most, (N, 2)."""
    at = np.unique(pixels.near(edge_points(look.trial)), axis=0)
    at = at[pixels.within(at)]
    at_um = np.array([pixels.world(row, column) for row, column in at])
    errors = expected_errors(look.trial, at_um)
    found: IntArray = _most(at, errors) if len(at) else at
    return found


def _most(at: IntArray, values: FloatArray) -> IntArray:
    """Return the pixels, (N, 2), of the largest values."""
    return at[values >= np.quantile(values, 1 - SHARE)]
