"""Faces on lattices of their own, packed for the loop over rays that meet them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from microplan.arrays import BoolArray, Float32Array, FloatArray, IntArray
from microplan.optics.layers.lattice import Lattice
from microplan.optics.render.scene import Layer

_CLOSE = 8.0  # points: rays that meet a face so close by are not moved to the nearest
_ROUNDING = 1e-6  # of full scale
_ONE = np.ones((1, 1), dtype=np.float32)


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFace:
    """All layers of one height, or the plane below, on points that rays meet."""

    z_um: float  # from focus
    lattice: Lattice  # wider by the blur than that which rays start from
    covers: Float32Array  # (rows, columns) on it
    sends: Float32Array  # reflectance times coverage
    light: Float32Array | None = None  # the share that arrives; None: all of it
    is_sharp: bool = False  # near focus: all rays of a point meet the same of it
    joins_light: bool = False  # blended with the blur of its product with the light
    finish: float = 0.0  # share of what it sends as a mirror: past `images`, no `light`
    images: tuple[JointFace, ...] = ()  # of higher faces in the mirror; black


def laid(
    layers: Sequence[Layer], points: Lattice, finer: float
) -> tuple[Float32Array, Float32Array]:
    """Return shares that layers of one height cover at points, and send.

    Two (rows, columns) arrays, 0..1. Where they overlap, one lies over the other.
    `finer`: as in `Lattice.covered`.
    """
    covers = sends = np.zeros(points.shape, dtype=np.float32)
    for number, layer in enumerate(layers):
        own = points.covered(layer, finer)
        sent = layer.reflectance * own
        if number == 0:
            covers, sends = own, sent
            continue
        free = 1 - own
        covers, sends = covers * free + own, sends * free + sent
    return covers, sends


@dataclass(frozen=True, slots=True, kw_only=True)
class MetFace:
    """The fields of a face where rays meet it; those that do not vary are one value."""

    is_sharp: bool
    sends_all: bool  # `sends` has its light in it
    of_covered: bool  # `sends` is of what is covered: one reflectance
    finish: float
    fields: tuple[Float32Array, ...]  # free, sends, light, of a mirror those below
    places: tuple[RayPlaces, ...]  # of each field

    @classmethod
    def of(cls, face: JointFace, rays: FloatArray, lattice: Lattice) -> MetFace:
        """Return what rays from the points of a lattice meet of a face.

        What it leaves free, sends, its light; of a mirror also what it sends without
        light, and what each image leaves free: shares. `rays`: tangents with the axis,
        (R, 2), um aside a um of height.
        """
        face, places = _on(face, rays, lattice)
        light = _ONE if face.light is None else face.light
        sends = face.sends * light if face.joins_light else face.sends
        one = None if face.joins_light else _reflectance(face)
        unlit = _even(face.sends if one is None else one)
        own = [
            _even(1 - face.covers),
            _even(sends) if face.joins_light else unlit,
            _even(light),
            *([unlit] if face.images else []),
        ]
        images = [_on(image, rays, lattice) for image in face.images]
        return cls(
            is_sharp=face.is_sharp,
            sends_all=face.joins_light,
            of_covered=one is not None,
            finish=face.finish,
            fields=(*own, *(_even(1 - image.covers) for image, _ in images)),
            places=(*[places] * len(own), *(there for _, there in images)),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RayPlaces:
    """Where rays from the first point of a lattice meet a face, (R,) points of it."""

    down: FloatArray
    right: FloatArray
    is_between: bool  # whether these are no whole numbers


@dataclass(frozen=True, slots=True, kw_only=True)
class PackedFaces:
    """Faces as `microplan.optics.layers.joint.ray_sums.residuals` has them."""

    values: Float32Array
    fields: IntArray
    down: FloatArray
    right: FloatArray
    is_between: BoolArray
    faces: IntArray
    finish: Float32Array

    @classmethod
    def of(cls, met: Sequence[MetFace]) -> PackedFaces:
        """Return faces, the lowest first."""
        arrays = [each for face in met for each in face.fields]
        places = [each for face in met for each in face.places]
        starts = np.cumsum([0, *(each.size for each in arrays)])[:-1]
        firsts = np.cumsum([0, *(len(face.fields) for face in met)])[:-1].tolist()
        fields = [
            (start, 0 if each.size == 1 else each.shape[1], place)
            for place, (start, each) in enumerate(zip(starts, arrays, strict=True))
        ]
        faces = [_numbers(f, first) for f, first in zip(met, firsts, strict=True)]
        return cls(
            values=np.concatenate([np.ravel(each) for each in arrays]),
            fields=np.array(fields, dtype=np.intp),
            down=np.array([each.down for each in places]),
            right=np.array([each.right for each in places]),
            is_between=np.array([each.is_between for each in places]),
            faces=np.array(faces, dtype=np.intp),
            finish=np.array([face.finish for face in met], dtype=np.float32),
        )


def _numbers(face: MetFace, first: int) -> tuple[int, ...]:
    """Return a face's row of numbers; its fields begin at the first."""
    light = face.fields[2]
    sends_all = face.sends_all or (light.size == 1 and light.item() == 1)
    flags = int(face.is_sharp), int(sends_all), int(face.of_covered)
    return (*flags, *range(first, first + 4), len(face.fields) - 4)


def varies(values: Float32Array) -> bool:
    """Return whether not all values (rows, columns), shares, are equal."""
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
    off = face.covers * found - face.sends
    return found if max(off.max(), -off.min()) <= _ROUNDING else None


def _on(
    face: JointFace, rays: FloatArray, lattice: Lattice
) -> tuple[JointFace, RayPlaces]:
    """Return a face on points as far apart as those of a lattice, and where it is met.

    The lattice is grown by as far as rays go aside.
    """
    at = face.z_um / lattice.step_um * rays.T * np.array([[1.0], [-1.0]])
    by = math.floor(np.abs(at).max()) + 2  # a point is left where places are between
    wide = lattice.grown(by)
    light = None if face.light is None else _read(face.light, face.lattice, wide)
    covers, sends = (
        _read(each, face.lattice, wide) for each in (face.covers, face.sends)
    )
    is_between = not face.is_sharp and by <= _CLOSE
    right, down = (at if is_between else np.rint(at)) + by
    places = RayPlaces(down=down, right=right, is_between=is_between)
    return replace(face, covers=covers, sends=sends, light=light), places


def _read(values: Float32Array, own: Lattice, lattice: Lattice) -> Float32Array:
    """Return values of one lattice at the points of another, linear between."""
    if not varies(values):
        return values[:1, :1]
    (x, y), (left, top) = lattice.corner_um, own.corner_um
    k = lattice.step_um / own.step_um
    right, down = (x - left) / own.step_um, (top - y) / own.step_um
    rows, columns = lattice.shape
    # places are whole thirty-seconds of a point, as `warpAffine` rounds them
    found = cv2.warpAffine(
        values,
        np.array([[k, 0.0, right], [0.0, k, down]]),
        (columns, rows),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(found, dtype=np.float32)
