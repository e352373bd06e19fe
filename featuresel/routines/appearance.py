"""How a target looks at any place, turn, focus and zoom, read from planes made once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from featuresel.routines import Artifact, FloatArray
from featuresel.routines.spline import Basis, basis, cubic_weights

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.intp]
Float32Array = npt.NDArray[np.float32]

BEYOND = 2  # planes past the range, where a natural spline's end no longer tells
_NEAR = 0.25  # of a step, beside focus: there the square's slope is taken


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Where the target is, px of the region, and how it is turned, focused, zoomed."""

    column: float
    row: float
    turn_rad: float  # from the template, counter-clockwise as displayed
    z_um: float
    zoom: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    """The target's light at N pixels, and what it changes by with the pose."""

    value: FloatArray  # (N,)
    across: FloatArray  # (N,) by a move of the target to the right, per px
    down: FloatArray  # (N,) by a move downwards, per px
    turn: FloatArray  # (N,) by a turn, per rad
    focus: FloatArray  # (N,) by focus, per um; where that is even, by its square
    grow: FloatArray  # (N,) by zoom, per unit of the ratio


@dataclass(frozen=True, slots=True, kw_only=True)
class Turned:
    """Pixels of N cells at T turns, and the target's light there; (T, N) each."""

    columns: IntArray
    rows: IntArray
    inside: BoolArray  # in the region; else the nearest pixel of its border stands here
    value: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Appearance:
    """Planes of a target's light, ready to be read."""

    planes: Float32Array  # (focus, turn harmonics, cells); the first cell is nothing
    cells: IntArray  # (rows * columns,) of the template: where each one is kept
    uses: IntArray  # (rows * columns,) bit g is set: worth comparing at focus g
    shape: tuple[int, int]  # of the template
    over: int  # samples per pixel
    middle: tuple[float, float]  # (column, row) of the reference point in the template
    first_um: float  # focus of the first plane
    step_um: float
    is_even: bool  # images on both sides of focus are alike
    heights: int  # of focus that `uses` tells apart

    @property
    def reach_um(self) -> float:
        """Return how far from nominal the planes go."""
        return self.first_um + (len(self.planes) - 1 - BEYOND) * self.step_um

    def pixels(self, pose: Pose, shape: tuple[int, ...]) -> tuple[IntArray, IntArray]:
        """Return (columns, rows) of a region's pixels that are worth comparing."""
        half = math.hypot(*self.shape) / 2 / self.over * pose.zoom
        left = max(0, math.ceil(pose.column - half))
        right = min(shape[1] - 1, math.floor(pose.column + half))
        top = max(0, math.ceil(pose.row - half))
        bottom = min(shape[0] - 1, math.floor(pose.row + half))
        across, down = max(right + 1 - left, 0), max(bottom + 1 - top, 0)
        rows, columns = np.mgrid[top : top + down, left : left + across]
        flat_columns, flat_rows = columns.ravel(), rows.ravel()
        x, y = self._place(pose, flat_columns, flat_rows)
        inside = (x >= 0) & (x <= self.shape[1] - 1) & (y >= 0)
        inside &= y <= self.shape[0] - 1
        nearest = np.rint(np.where(inside, y, 0)).astype(np.intp) * self.shape[1]
        nearest += np.rint(np.where(inside, x, 0)).astype(np.intp)
        good = inside & (self.uses[nearest] & self._bits(pose.z_um) > 0)
        return flat_columns[good], flat_rows[good]

    def some_cells(self, z_um: float, count: int) -> IntArray:
        """Return about `count` of the cells that are worth comparing at a focus."""
        cells = np.flatnonzero(self.uses & self._bits(z_um))
        return cells[:: max(1, len(cells) // count)]

    def turned(
        self, pose: Pose, turns: FloatArray, cells: IntArray, shape: tuple[int, ...]
    ) -> Turned:
        """Return the light of the pixels that some cells fall on, at many turns.

        Parameters
        ----------
        pose : Pose
            Place, focus and zoom; its turn does not matter.
        turns : (T,) float array
            Turns from the template, rad.
        cells : (N,) int array
            Of the template, by `some_cells`.
        shape : (rows, columns)
            Of the region.
        """
        c, s = np.cos(turns)[:, None], np.sin(turns)[:, None]
        k = self.over / pose.zoom
        x = (cells % self.shape[1] - self.middle[0]) / k
        y = (cells // self.shape[1] - self.middle[1]) / k
        columns = np.rint(pose.column + c * x + s * y).astype(np.intp)
        rows = np.rint(pose.row - s * x + c * y).astype(np.intp)
        inside = (columns >= 0) & (columns < shape[1])
        inside &= (rows >= 0) & (rows < shape[0])
        u, v = columns - pose.column, rows - pose.row
        near, (wx, _), (wy, _) = self._around(
            (self.middle[0] + k * (c * u - s * v)).ravel(),
            (self.middle[1] + k * (s * u + c * v)).ravel(),
        )
        at = self._basis(abs(pose.z_um) if self.is_even else pose.z_um)
        value = np.zeros(columns.size)
        for wave, plane in self._harmonics(turns):
            mixed = self._mixed(at.first, np.outer(at.weights, plane))
            lines = np.einsum("nij,jn->ni", mixed[near], wx)
            light = np.einsum("ni,in->n", lines, wy)
            value += np.repeat(wave, len(cells)) * light
        return Turned(
            columns=np.clip(columns, 0, shape[1] - 1),
            rows=np.clip(rows, 0, shape[0] - 1),
            inside=inside,
            value=value.reshape(columns.shape),
        )

    def _bits(self, z_um: float) -> int:
        """Return the bits of the two heights about a focus that `uses` tells apart."""
        low_um = 0.0 if self.is_even else self.first_um
        place = (abs(z_um) if self.is_even else z_um) - low_um
        share = place / (self.reach_um + BEYOND * self.step_um - low_um)
        lower = min(max(math.floor(share * (self.heights - 1)), 0), self.heights - 2)
        return 3 << lower

    def light(self, pose: Pose, columns: IntArray, rows: IntArray) -> Light:
        """Return the target's light at pixels (N,), and its slopes."""
        value, by_focus = self._focused(pose)
        cells, (wx, sx), (wy, sy) = self._near(pose, columns, rows)
        near = value[cells]
        lines = np.einsum("nij,jn->ni", near, wx)
        leaning = np.einsum("nij,jn->ni", near, sx)
        deep = np.einsum("nij,jn->ni", by_focus[cells], wx)
        read = [(lines, wy), (leaning, wy), (lines, sy), (deep, wy)]
        mean, by_x, by_y, by_z = (
            np.einsum("ni,in->n", a, b).astype(np.float64) for a, b in read
        )
        return self._slopes(pose, columns, rows, (mean, by_x, by_y, by_z))

    def _near(
        self, pose: Pose, columns: IntArray, rows: IntArray
    ) -> tuple[IntArray, tuple[Float32Array, ...], tuple[Float32Array, ...]]:
        """Return 16 cells around each pixel, (N, 4, 4), and weights across and down."""
        return self._around(*self._place(pose, columns, rows))

    def _around(
        self, x: FloatArray, y: FloatArray
    ) -> tuple[IntArray, tuple[Float32Array, ...], tuple[Float32Array, ...]]:
        """Return the same for places in the template, in samples."""
        left = np.clip(np.floor(x).astype(np.intp), 1, self.shape[1] - 3)
        top = np.clip(np.floor(y).astype(np.intp), 1, self.shape[0] - 3)
        start = (top - 1) * self.shape[1] + left - 1
        grid = np.arange(4)[:, None] * self.shape[1] + np.arange(4)
        cells = self.cells[start[:, None] + grid.ravel()].reshape(-1, 4, 4)
        across = cubic_weights((x - left).astype(np.float32))
        down = cubic_weights((y - top).astype(np.float32))
        return cells, across, down

    def _slopes(
        self,
        pose: Pose,
        columns: IntArray,
        rows: IntArray,
        read: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    ) -> Light:
        """Return slopes by the pose from those along the template's samples."""
        mean, by_x, by_y, by_z = read
        c, s = math.cos(pose.turn_rad), math.sin(pose.turn_rad)
        k = self.over / pose.zoom
        # a move of the target is the opposite move of the pixels over the template
        across, down = -k * (c * by_x + s * by_y), -k * (c * by_y - s * by_x)
        u, v = columns - pose.column, rows - pose.row
        return Light(
            value=mean,
            across=across,
            down=down,
            # counter-clockwise as displayed: right goes up, up goes left
            turn=across * v - down * u,
            focus=by_z,
            grow=(across * u + down * v) / pose.zoom,
        )

    def _place(
        self, pose: Pose, columns: IntArray, rows: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return where pixels lie in the template, in samples."""
        c, s = math.cos(pose.turn_rad), math.sin(pose.turn_rad)
        u, v = columns - pose.column, rows - pose.row
        k = self.over / pose.zoom
        return self.middle[0] + k * (c * u - s * v), self.middle[1] + k * (
            s * u + c * v
        )

    def _focused(self, pose: Pose) -> tuple[Float32Array, Float32Array]:
        """Return coefficients of all cells at a focus and turn, and by focus."""
        z_um = abs(pose.z_um) if self.is_even else pose.z_um
        at = self._basis(z_um)
        slopes, first = at.slopes / self.step_um, at.first
        if self.is_even:  # by the square of the focus, finite where its slope is not
            off_um = max(z_um, _NEAR * self.step_um)
            beside = self._basis(off_um)
            slopes, first = beside.slopes / self.step_um / (2 * off_um), beside.first
        turns = self._turns(pose)
        return (
            self._mixed(at.first, np.outer(at.weights, turns)),
            self._mixed(first, np.outer(slopes, turns)),
        )

    def _harmonics(self, turns: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """Return for each plane its weights at all turns, and what picks it out."""
        if self.planes.shape[1] == 1:
            return [(np.ones(len(turns)), np.ones(1))]
        waves = (np.ones(len(turns)), np.cos(4 * turns), np.sin(4 * turns))
        return list(zip(waves, np.eye(3), strict=True))

    def _turns(self, pose: Pose) -> FloatArray:
        """Return the weights of the planes' harmonics."""
        if self.planes.shape[1] == 1:
            return np.array([1.0])
        turn = 4 * pose.turn_rad
        return np.array([1.0, math.cos(turn), math.sin(turn)])

    def _basis(self, z_um: float) -> Basis:
        """Return the planes' weights at a focus."""
        return basis((z_um - self.first_um) / self.step_um, len(self.planes))

    def _mixed(self, first: int, weights: FloatArray) -> Float32Array:
        """Return the weighted sum of four planes' (4, harmonics) coefficients."""
        near = self.planes[first : first + 4]
        mixed: Float32Array = weights.ravel().astype(np.float32) @ near.reshape(
            -1, near.shape[2]
        )
        return mixed


def read_appearance(artifact: Artifact) -> Appearance:
    """Return the planes that `prepare_planes` made."""
    p: Mapping[str, float] = artifact.parameters
    where = artifact.arrays["cells"]
    return Appearance(
        planes=artifact.arrays["planes"],
        cells=where.ravel().astype(np.intp),
        uses=artifact.arrays["uses"].ravel().astype(np.intp),
        shape=(where.shape[0], where.shape[1]),
        over=int(p["over"]),
        middle=(p["middle_column"], p["middle_row"]),
        first_um=p["first_um"],
        step_um=p["step_um"],
        is_even=p["is_even"] > 0,
        heights=int(p["heights"]),
    )
