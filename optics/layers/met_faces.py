"""Faces on lattices, and what rays from points in the plane in focus meet of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from microplan.arrays import Float32Array, FloatArray
from microplan.optics.layers.lattice import Lattice

_CLOSE = 8.0  # points: rays that meet a face so close by are not moved to the nearest
_ROUNDING = 1e-6  # of full scale


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFace:
    """All layers of one height, or the plane below, on points that rays meet."""

    z_um: float  # from focus
    covers: Float32Array  # (rows, columns), wider than the lattice by the blur
    sends: Float32Array  # reflectance times coverage
    light: Float32Array | None = None  # the share that arrives; None: all of it
    is_sharp: bool = False  # near focus: all rays of a point meet the same of it
    joins_light: bool = False  # blended with the blur of its product with the light
    finish: float = 0.0  # share of what it sends as a mirror: past `images`, no `light`
    images: tuple[JointFace, ...] = ()  # of higher faces in the mirror; black


@dataclass(frozen=True, slots=True, kw_only=True)
class MetFace:
    """A face with where rays meet it."""

    is_sharp: bool
    sends_all: bool  # `sends` has its light in it
    of_covered: bool  # `sends` is of what is covered: one reflectance
    free: Float32Array  # that it does not cover: (rows, columns), or one value
    sends: Float32Array
    light: Float32Array
    down: list[float]  # the row that each ray from the first point meets
    right: list[float]  # the column
    is_between: bool  # whether these are no whole numbers
    columns: int  # of the lattice
    finish: float
    unlit: Float32Array  # `sends` without light
    images: tuple[MetFace, ...]

    @classmethod
    def of(cls, face: JointFace, rays: FloatArray, lattice: Lattice) -> Self:
        """Return where a face is met by rays from all points of a lattice.

        `rays`: tangents with the axis, (N, 2).
        """
        by = (face.covers.shape[0] - lattice.shape[0]) // 2
        at = face.z_um / lattice.step_um * rays.T * np.array([[1.0], [-1.0]]) + by
        is_between = not face.is_sharp and by <= _CLOSE
        if not is_between:
            at = np.rint(at).astype(np.intp)
        light = np.ones((1, 1), dtype=np.float32) if face.light is None else face.light
        sends = face.sends * light if face.joins_light else face.sends
        one = None if face.joins_light else _reflectance(face)
        unlit = _even(face.sends if one is None else one)
        return cls(
            is_sharp=face.is_sharp,
            sends_all=face.joins_light,
            of_covered=one is not None,
            free=_even(1 - face.covers),
            sends=_even(sends) if face.joins_light else unlit,
            light=_even(light),
            down=at[1].tolist(),
            right=at[0].tolist(),
            is_between=is_between,
            columns=lattice.shape[1],
            finish=face.finish,
            unlit=unlit,
            images=tuple(cls.of(image, rays, lattice) for image in face.images),
        )

    def met(self, rays: slice, rows: slice) -> tuple[Float32Array, ...]:
        """Return what rays from some rows of points meet: free, sends, light.

        Each (rays, rows, columns), or (1, 1, 1) of what is even. Of a mirror also what
        it sends without light, and what each image leaves free.
        """
        values = [self.free, self.sends, self.light]
        if self.images:
            values.append(self.unlit)
        found = (self.meet(each, rays, rows) for each in values)
        past = (each.meet(each.free, rays, rows) for each in self.images)
        return (*found, *past)

    def meet(self, values: Float32Array, rays: slice, rows: slice) -> Float32Array:
        """Return values that rays meet, or the only one."""
        return values[None] if values.size == 1 else self._read(values, rays, rows)

    def _read(self, values: Float32Array, rays: slice, rows: slice) -> Float32Array:
        """Return the values that rays meet, (rays, rows, columns)."""
        down, across = self.down[rays], self.right[rays]
        height, width = rows.stop - rows.start, self.columns
        below = values[rows.start :]
        if len(down) == 1 and not self.is_between:
            row, column = int(down[0]), int(across[0])
            return below[None, row : row + height, column : column + width]
        if not self.is_between:
            at = np.array([down, across], dtype=np.intp)
            seen: Float32Array = sliding_window_view(below, (height, width))
            gathered: Float32Array = seen[at[0], at[1]]
            return gathered
        found = np.empty((len(down), height, width), dtype=np.float32)
        below = np.ascontiguousarray(below)
        for out, y, x in zip(found, down, across, strict=True):
            middle = x + (width - 1) / 2, y + (height - 1) / 2
            cv2.getRectSubPix(below, (width, height), middle, out)
        return found


def varies(values: Float32Array) -> bool:
    """Return whether not all values are equal."""
    return bool(values.min() < values.max())


def _even(values: Float32Array) -> Float32Array:
    """Return values, or the only one."""
    return values if varies(values) else values[:1, :1]


def _reflectance(face: JointFace) -> Float32Array | None:
    """Return what a face sends of what it covers, (1, 1); None if that varies."""
    most = face.covers.max()
    if most == 0:
        return None
    found = (face.sends.max() / most).reshape(1, 1)
    off = face.covers * found
    off -= face.sends
    return found if max(off.max(), -off.min()) <= _ROUNDING else None
