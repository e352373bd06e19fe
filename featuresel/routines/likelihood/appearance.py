"""A target's look at any position, rotation, focus and zoom, read from planes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from microplan.arrays import BoolArray, Float32Array, FloatArray, IntArray
from microplan.featuresel.routines.contract import Artifact
from microplan.featuresel.routines.likelihood.spline import Basis, basis, cubic_weights

BEYOND = 2  # planes past the range, where a natural spline's end no longer tells
AGAIN_PX = 0.5  # a move of the target after which its pixels are chosen anew
_APART = 7  # cells of the template that a few are taken from, no row like the last
_NEAR = 0.25  # of a step, beside focus: there the square's slope is taken


@dataclass(frozen=True, slots=True, kw_only=True)
class OccluderBlur:
    """How the occluder is blurred: as some other defocus model might do it."""

    focus_um: float  # off nominal
    core: float = 0.0  # share of its light that is blurred less
    # its displacement in standard deviations of each occluder mode; none is 0
    occluder_modes: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ImagePose:
    """Where the target is, px of the region, and how it is turned, focused, zoomed."""

    column: float
    row: float
    turn_rad: float  # from the template, counter-clockwise as displayed
    z_um: float
    zoom: float
    front: OccluderBlur | None = None  # None: the occluder has the target's focus

    @property
    def occluder_blur(self) -> OccluderBlur:
        """Return how the occluder is blurred."""
        return self.front or OccluderBlur(focus_um=self.z_um)


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetLight:
    """The target's light at N pixels, and what it changes by with the pose."""

    value: FloatArray  # (N,)
    across: FloatArray  # (N,) by a move of the target to the right, per px
    down: FloatArray  # (N,) by a move downwards, per px
    turn: FloatArray  # (N,) by a turn, per rad
    focus: FloatArray  # (N,) by focus, per um; where that is even, by its square
    grow: FloatArray  # (N,) by zoom, per unit of the ratio


@dataclass(frozen=True, slots=True, kw_only=True)
class Turned:
    """Pixels of N cells at T rotations, and the target's light there; (T, N) each."""

    columns: IntArray
    rows: IntArray
    inside: BoolArray  # in the region; else the nearest pixel of its border stands here
    value: FloatArray


@dataclass(frozen=True, slots=True)
class _Taps:
    """The 16 cells of a template that a spline at each of N positions reads."""

    cells: IntArray  # (4 down, 4 across, N)
    weights: tuple[Float32Array, Float32Array]  # across, down; (4, N) each
    slopes: tuple[Float32Array, Float32Array]  # per sample

    def read(self, near: Float32Array) -> Float32Array:
        """Return the spline's value, (N,), from coefficients (4, 4, N)."""
        lines = (near * self.weights[0]).sum(axis=1)
        value: Float32Array = (lines * self.weights[1]).sum(axis=0)
        return value


@dataclass(frozen=True, slots=True, kw_only=True)
class Appearance:
    """Planes of a target's light, ready to be read."""

    planes: Float32Array  # (focus, turn harmonics, cells); the first cell is nothing
    cells: Float32Array  # (rows * columns,) of the template: where each one is kept
    uses: Float32Array  # (rows, columns) bit g is set: worth comparing at focus g
    shape: tuple[int, int]  # of the template
    over: int  # samples per pixel
    middle: tuple[float, float]  # (column, row) of the reference point in the template
    first_um: float  # focus of the first plane
    step_um: float
    is_even: bool  # images on both sides of focus are alike
    heights: int  # of focus that `uses` distinguishes

    @property
    def reach_um(self) -> float:
        """Return how far from nominal the planes go."""
        return self.first_um + (len(self.planes) - 1 - BEYOND) * self.step_um

    def pixels(
        self, pose: ImagePose, shape: tuple[int, ...]
    ) -> tuple[IntArray, IntArray]:
        """Return (columns, rows) of a region's pixels that are worth comparing."""
        half = math.hypot(*self.shape) / 2 / self.over * pose.zoom
        left = max(0, math.ceil(pose.column - half))
        right = min(shape[1] - 1, math.floor(pose.column + half))
        top = max(0, math.ceil(pose.row - half))
        bottom = min(shape[0] - 1, math.floor(pose.row + half))
        if right < left or bottom < top:
            return np.zeros(0, np.intp), np.zeros(0, np.intp)
        uses = cv2.warpAffine(
            self.uses,
            self._affine(pose, left, top),
            (right + 1 - left, bottom + 1 - top),
            flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
        )
        rows, columns = np.nonzero(uses.astype(np.int32) & self._bits(pose.z_um))
        return columns + left, rows + top

    def _affine(self, pose: ImagePose, left: int, top: int) -> FloatArray:
        """Return the (2, 3) map from pixels of a part of the region to samples."""
        c, s = math.cos(pose.turn_rad), math.sin(pose.turn_rad)
        k, u, v = self.over / pose.zoom, left - pose.column, top - pose.row
        return np.array(
            [
                [k * c, -k * s, self.middle[0] + k * (c * u - s * v)],
                [k * s, k * c, self.middle[1] + k * (s * u + c * v)],
            ]
        )

    def some_cells(self, z_um: float, count: int) -> IntArray:
        """Return indices of about `count` cells worth comparing at a focus, (N,)."""
        every = next(k for k in (_APART, _APART + 2) if self.shape[1] % k)
        bits, uses = self._bits(z_um), self.uses.ravel()
        cells = every * np.flatnonzero(uses[::every].astype(np.int32) & bits)
        if len(cells) < count:
            cells = np.flatnonzero(uses.astype(np.int32) & bits)
        return cells[:: max(1, len(cells) // count)]

    def turned(
        self,
        pose: ImagePose,
        turns: FloatArray,
        cells: IntArray,
        shape: tuple[int, ...],
        *,
        rough: bool = False,
    ) -> Turned:
        """Return the light of the pixels that some cells fall on, at many rotations.

        Parameters
        ----------
        pose : Pose
            Position, focus and zoom; its rotation does not matter.
        turns : (T,) float array
            Rotations from the template, rad.
        cells : (N,) int array
            Of the template, by `some_cells`.
        shape : (rows, columns)
            Of the region.
        rough : bool
            Whether pixels may count as round: at a third of the work.
        """
        c, s = np.cos(turns)[:, None], np.sin(turns)[:, None]
        k = self.over / pose.zoom
        x = (cells % self.shape[1] - self.middle[0]) / k
        y = (cells // self.shape[1] - self.middle[1]) / k
        columns = np.rint(pose.column + c * x + s * y).astype(np.intp)
        rows = np.rint(pose.row - s * x + c * y).astype(np.intp)
        inside = (columns >= 0) & (columns < shape[1])
        inside &= (rows >= 0) & (rows < shape[0])
        return Turned(
            columns=np.clip(columns, 0, shape[1] - 1),
            rows=np.clip(rows, 0, shape[0] - 1),
            inside=inside,
            value=self.values(pose, turns, columns, rows, rough=rough),
        )

    def values(
        self,
        pose: ImagePose,
        turns: FloatArray,
        columns: IntArray,
        rows: IntArray,
        *,
        rough: bool = False,
    ) -> FloatArray:
        """Return the target's light at (T, N) pixels, (T,) rotations, see `turned`."""
        c, s = np.cos(turns)[:, None], np.sin(turns)[:, None]
        u, v, k = columns - pose.column, rows - pose.row, self.over / pose.zoom
        taps = self._taps(
            (self.middle[0] + k * (c * u - s * v)).ravel(),
            (self.middle[1] + k * (s * u + c * v)).ravel(),
        )
        at = self._basis(abs(pose.z_um) if self.is_even else pose.z_um)
        near = self.planes[at.first : at.first + 4]
        weights, value = at.weights.astype(np.float32), np.zeros(columns.shape)
        for h, wave in enumerate(self._waves(turns)[: 1 if rough else None]):
            light = taps.read((weights @ near[:, h]).take(taps.cells))
            value += wave[:, None] * light.reshape(columns.shape)
        return value

    def _bits(self, z_um: float) -> int:
        """Return the bits of the two heights of `uses` about a focus."""
        low_um = 0.0 if self.is_even else self.first_um
        place = (abs(z_um) if self.is_even else z_um) - low_um
        share = place / (self.reach_um + BEYOND * self.step_um - low_um)
        lower = min(max(math.floor(share * (self.heights - 1)), 0), self.heights - 2)
        return 3 << lower

    def light(self, pose: ImagePose, columns: IntArray, rows: IntArray) -> TargetLight:
        """Return the target's light at pixels (N,), and its slopes."""
        taps = self._taps(*self._place(pose, columns, rows))
        near = self._focused(pose).take(taps.cells, axis=1)
        (wx, wy), (sx, sy) = taps.weights, taps.slopes
        lines = (near * wx).sum(axis=2)  # value and by focus, at four heights
        leaning = (near[0] * sx).sum(axis=1)
        value, by_z = (lines * wy).sum(axis=1).astype(np.float64)
        by_x = (leaning * wy).sum(axis=0).astype(np.float64)
        by_y = (lines[0] * sy).sum(axis=0).astype(np.float64)
        return self._slopes(pose, columns, rows, (value, by_x, by_y, by_z))

    def _taps(self, x: FloatArray, y: FloatArray) -> _Taps:
        """Return the cells around (N,) positions in the template, in samples."""
        left = np.clip(np.floor(x), 1, self.shape[1] - 3)
        top = np.clip(np.floor(y), 1, self.shape[0] - 3)
        start = ((top - 1) * self.shape[1] + left - 1).astype(np.intp)
        grid = np.arange(4)[:, None] * self.shape[1] + np.arange(4)
        cells = self.cells.take(start + grid[:, :, None]).astype(np.intp)
        weights, slopes = cubic_weights(
            np.stack((x - left, y - top)).astype(np.float32)
        )
        return _Taps(
            cells, (weights[:, 0], weights[:, 1]), (slopes[:, 0], slopes[:, 1])
        )

    def _slopes(
        self,
        pose: ImagePose,
        columns: IntArray,
        rows: IntArray,
        read: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    ) -> TargetLight:
        """Return slopes by the pose from those along the template's samples."""
        mean, by_x, by_y, by_z = read
        c, s = math.cos(pose.turn_rad), math.sin(pose.turn_rad)
        k = self.over / pose.zoom
        # a move of the target is the opposite move of the pixels over the template
        across, down = -k * (c * by_x + s * by_y), -k * (c * by_y - s * by_x)
        u, v = columns - pose.column, rows - pose.row
        return TargetLight(
            value=mean,
            across=across,
            down=down,
            # counter-clockwise as displayed: right goes up, up goes left
            turn=across * v - down * u,
            focus=by_z,
            grow=(across * u + down * v) / pose.zoom,
        )

    def _place(
        self, pose: ImagePose, columns: IntArray, rows: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return where pixels lie in the template, in samples."""
        c, s = math.cos(pose.turn_rad), math.sin(pose.turn_rad)
        u, v = columns - pose.column, rows - pose.row
        k = self.over / pose.zoom
        return self.middle[0] + k * (c * u - s * v), self.middle[1] + k * (
            s * u + c * v
        )

    def _focused(self, pose: ImagePose) -> Float32Array:
        """Return coefficients of all cells at a focus and rotation, and by focus."""
        z_um = abs(pose.z_um) if self.is_even else pose.z_um
        at = slope_at = self._basis(z_um)
        slopes = slope_at.slopes / self.step_um
        if self.is_even:  # by the square of the focus, finite where its slope is not
            off_um = max(z_um, _NEAR * self.step_um)
            slope_at = self._basis(off_um)
            slopes = slope_at.slopes / self.step_um / (2 * off_um)
        first, last = min(at.first, slope_at.first), max(at.first, slope_at.first) + 4
        weights = np.zeros((2, last - first))
        weights[0, at.first - first :][:4] = at.weights
        weights[1, slope_at.first - first :][:4] = slopes
        waves = self._waves(np.array([pose.turn_rad]))[:, 0]
        mixed = (weights[:, :, None] * waves).reshape(2, -1).astype(np.float32)
        near = self.planes[first:last].reshape(-1, self.planes.shape[2])
        focused: Float32Array = np.empty((2, near.shape[1]), np.float32)
        for weight, light in zip(mixed, focused, strict=True):
            # one row at a time: BLAS is slower by half with two
            np.dot(weight, near, out=light)
        return focused

    def _waves(self, turns: FloatArray) -> FloatArray:
        """Return the weights of the planes at some rotations, (harmonics, T)."""
        waves = np.stack((np.ones(len(turns)), np.cos(4 * turns), np.sin(4 * turns)))
        return waves[: self.planes.shape[1]]

    def _basis(self, z_um: float) -> Basis:
        """Return the planes' weights at a focus."""
        return basis((z_um - self.first_um) / self.step_um, len(self.planes))


def read_appearance(artifact: Artifact) -> Appearance:
    """Return the planes that `prepare_planes` made."""
    p: Mapping[str, float] = artifact.parameters
    where = artifact.arrays["cells"]
    return Appearance(
        planes=artifact.arrays["planes"],
        cells=where.ravel(),
        uses=artifact.arrays["uses"],
        shape=(where.shape[0], where.shape[1]),
        over=int(p["over"]),
        middle=(p["middle_column"], p["middle_row"]),
        first_um=p["first_um"],
        step_um=p["step_um"],
        is_even=p["is_even"] > 0,
        heights=int(p["heights"]),
    )
