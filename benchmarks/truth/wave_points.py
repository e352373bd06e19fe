"""Errors of both roads at single points of a look, against waves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.truth.compiler_side import trial_image
from benchmarks.truth.judged_looks import JudgedLook, cell_image
from benchmarks.truth.waves import wave_scene
from microplan.arrays import FloatArray, IntArray

POINT = 1e-6  # share of a pixel that sees light: waves are taken at points
REACH_PX = 40.0  # points lie so far from the region's middle, at most
STEEPEST = 0.1  # of pixels: at edges


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

    Half of them of all there, half of the tenth where the compiler's picture changes
    most from pixel to pixel: diffraction is stronger at edges.
    """
    scope, view = look.trial.case.microscope, look.cell.view
    case = replace(look.trial.case, microscope=replace(scope, fill_factor=POINT))
    cell = replace(look.cell, view=replace(view, fill_factor=POINT))
    pictures = trial_image(case), cell_image(cell)
    window, scale = look.cell.window, view.px_per_um
    reach = min(REACH_PX, (min(window.rows, window.columns) - 1) / 2)
    middle = (window.rows - 1) / 2, (window.columns - 1) / 2
    row, column = _drawn(pictures[0], middle, reach, points)

    def world(at_row: float, at_column: float) -> tuple[float, float]:
        x = (window.column + at_column - (view.width_px - 1) / 2) / scale
        return x, ((view.height_px - 1) / 2 - window.row - at_row) / scale

    scene = wave_scene(cell.scene, cell.view, world(*middle), (reach + 1) / scale)
    truth = np.array(
        [scene.image(*world(r, c)) for r, c in zip(row, column, strict=True)]
    )
    errors = [picture[row, column] - truth for picture in pictures]
    return WaveErrors(compiler=errors[0], cell=errors[1])


def _drawn(
    picture: FloatArray, middle: tuple[float, float], reach: float, count: int
) -> tuple[IntArray, IntArray]:
    """Return rows and columns, (count,) each, within a reach of the middle."""
    near = np.hypot(*(np.indices(picture.shape).T - np.array(middle)).T) <= reach
    steep = np.hypot(*np.gradient(picture))
    edges = near & (steep >= np.quantile(steep[near], 1 - STEEPEST))
    rng = np.random.default_rng(count)
    parts = (near, count - count // 2), (edges, count // 2)
    found = [
        rng.choice(np.argwhere(where), size, replace=False) for where, size in parts
    ]
    row, column = np.concatenate(found).T
    return row, column
