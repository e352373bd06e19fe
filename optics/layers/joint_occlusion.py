"""Joint effect of bodies far from focus: means of products, by rays on a lattice.

Of the rays from one point of the image those that pass one body out of focus meet other
parts of the next one than those that do not. The mean of a product is not that of the
means then. The difference is smooth where all of them are far from focus; what lies
near focus multiplies it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from microplan.arrays import Float32Array, FloatArray
from microplan.optics.layers.lattice import Lattice, blur
from microplan.optics.layers.rays import slopes
from microplan.optics.transfer.microscope import Microscope

# Rays a point, as many as the time allows: the errors of means fall nearly with their
# number (`benchmarks/optics/shading.py`).
_FEWEST, _MOST, _SAMPLES = 64, 1024, 1 << 21
_CLOSE = 8.0  # points: rays that meet a face so close by are not moved to the nearest
_FINEST = 2.0  # points: what is smaller is no mean
WIDEST = 300  # points aside that a ray may meet a face: a limit to memory
_AT_ONCE = 1 << 16  # values of one array: they stay in the cache


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFace:
    """All layers of one height, or the plane below, on points that rays meet."""

    z_um: float  # from focus
    covers: Float32Array  # (rows, columns), wider than the lattice by the blur
    sends: Float32Array  # reflectance times coverage
    light: Float32Array | None = None  # the share that arrives; None: all of it
    is_sharp: bool = False  # near focus: all rays of a point meet the same of it
    joins_light: bool = False  # blended with the blur of its product with the light


@dataclass(frozen=True, slots=True, kw_only=True)
class JointResidual:
    """Residuals of blending on a lattice, by what they are multiplied with."""

    above: FloatArray  # (rows, columns): of what lies above all that is sharp
    # of the light that leaves each sharp face for a reflectance of 1, the lowest first
    sharp: tuple[FloatArray, ...]
    below: FloatArray  # of what lies below, where nothing sharp hides it


AnyFloats = FloatArray | Float32Array


@dataclass(frozen=True, slots=True)
class _Sums:
    """Sums over rays."""

    seen: list[FloatArray]  # (rows, columns): the fields of `JointResidual`
    alone: list[list[FloatArray]]  # of what each face covers, sends and gets


def wide(lattice: Lattice, microscope: Microscope, z_um: float) -> Lattice:
    """Return the points that rays meet `z_um` out of focus."""
    reach_um = microscope.blur_diameter_um(z_um) / 2
    return lattice.grown(math.floor(reach_um / lattice.step_um) + 1)


def joint_residual(
    faces: Sequence[JointFace],
    lattice: Lattice,
    microscope: Microscope,
    *,
    rays: int | None = None,
    spin_rad: float = 0.0,
    diffracts: bool = True,
) -> JointResidual | None:
    """Return the residual of blending faces, on the points of a lattice.

    Parameters
    ----------
    faces : sequence of JointFace
        The lowest first; sharp ones in one run.
    lattice : Lattice
        Points in the plane in focus.
    rays : int, optional
        A point. Default: as many as its time allows, a power of two.
    spin_rad : float
        By which their pattern is turned: what two patterns differ by is its error.
    diffracts : bool
        Whether it is seen by the lens, and averaged over pixels.

    Returns
    -------
    JointResidual or None
        Shares of full scale, to be added to faces blended with each's coverage times
        the blurred light on it. None where no two of them are uneven: there is none.
    """
    faces = _not_hidden(faces)
    if _uneven(faces) < 2:
        return None
    rays = rays or _rays(lattice)
    c, s = math.cos(spin_rad), math.sin(spin_rad)
    tangents = slopes(microscope, rays) @ np.array([[c, s], [-s, c]])
    faces = [_softened(face, lattice, microscope, rays) for face in faces]
    sums = _traced(faces, tangents, lattice)
    means = [[part / rays for part in parts] for parts in sums.alone]
    change = [
        (seen / rays - blended).reshape(lattice.shape)
        for seen, blended in zip(sums.seen, _composite(faces, means), strict=True)
    ]
    if diffracts:
        # as in `microplan.optics.layers.occlusion`: what meets in focus is cut off
        # before it diffracts
        change = list(blur(np.stack(change), lattice.step_um, microscope, "exact", 0.0))
    below, *sharp, above = change
    return JointResidual(above=above, sharp=tuple(sharp), below=below)


def _rays(lattice: Lattice) -> int:
    """Return how many rays a point gets on a lattice."""
    rows, columns = lattice.shape
    share = max(_SAMPLES // (rows * columns), 1)
    return int(min(max(1 << (share.bit_length() - 1), _FEWEST), _MOST))


def _not_hidden(faces: Sequence[JointFace]) -> Sequence[JointFace]:
    """Return faces, the lowest first, from the highest that hides all below it on.

    The sharp ones above are kept in any case.
    """
    full = [k for k, f in enumerate(faces) if not f.is_sharp and f.covers.min() == 1]
    first = full[-1] if full else 0
    return [f for k, f in enumerate(faces) if k >= first or f.is_sharp]


def _uneven(faces: Sequence[JointFace]) -> int:
    """Return how many factors vary over the rays of a point."""
    hiding = sum(not f.is_sharp and _varies(f.covers) for f in faces)
    # what sends light hides with the same coverage
    sending = sum(
        not f.is_sharp and not _varies(f.covers) and _varies(f.sends) for f in faces
    )
    return hiding + sending + sum(f.light is not None for f in faces)


def _varies(values: Float32Array) -> bool:
    return bool(values.min() < values.max())


def _softened(
    face: JointFace, lattice: Lattice, microscope: Microscope, rays: int
) -> JointFace:
    """Return a face averaged over squares as large as a ray's share of the pupil.

    A ray stands for a cell of the pupil, whose side is sqrt(pi / rays) of its radius.
    """
    if face.is_sharp:
        return face
    reach_um = microscope.blur_diameter_um(face.z_um) / 2
    size = math.sqrt(math.pi / rays) * reach_um / lattice.step_um
    return replace(
        face, covers=_boxed(face.covers, size), sends=_boxed(face.sends, size)
    )


def _boxed(values: Float32Array, size: float) -> Float32Array:
    """Return means over squares of an odd number of points near `size`."""
    if size < _FINEST or not _varies(values):
        return values
    odd = 2 * round((size - 1) / 2) + 1
    found: Float32Array = ndimage.uniform_filter(values, odd, mode="nearest")
    return found


def _traced(
    faces: Sequence[JointFace], tangents: FloatArray, lattice: Lattice
) -> _Sums:
    """Return sums over rays, as many at once as the cache holds."""
    rows, columns = lattice.shape
    block = max(1, _AT_ONCE // (rows * columns))
    views = [_views(face, lattice) for face in faces]
    fields = 2 + sum(face.is_sharp for face in faces)
    sums = _Sums(
        [np.zeros(lattice.shape) for _ in range(fields)],
        [[np.zeros(lattice.shape) for _ in range(3)] for _ in faces],
    )
    for first in range(0, len(tangents), block):
        rays = tangents[first : first + block]
        met = [
            _met_by(face, seen, rays, lattice)
            for face, seen in zip(faces, views, strict=True)
        ]
        for face_sums, parts in zip(sums.alone, met, strict=True):
            _add(face_sums, parts, len(rays))
        _add(sums.seen, _composite(faces, met), len(rays))
    return sums


def _add(sums: Sequence[FloatArray], parts: Sequence[AnyFloats], rays: int) -> None:
    """Add up a bundle of rays; what is even stands for all of them."""
    for k, part in enumerate(parts):
        sums[k][...] += part.sum(axis=0) if part.shape[0] == rays else rays * part[0]


def _composite(
    faces: Sequence[JointFace], parts: Sequence[Sequence[AnyFloats]]
) -> list[AnyFloats]:
    """Return the fields of faces, each hiding those below: of rays, or of means.

    Below all that is sharp, of each sharp face, above.
    """
    nothing: AnyFloats = np.zeros((1, 1, 1), dtype=np.float32)
    found: list[AnyFloats] = []
    current = nothing
    for face, (covers, sends, light) in zip(faces, parts, strict=True):
        if face.is_sharp:
            found = [*found, light] if found else [current, light]
            current = nothing
            continue
        free = 1 - covers
        found = [each * free for each in found]
        current = current * free + (sends if face.joins_light else sends * light)
    return [*found, current] if found else [current, nothing]


def _views(face: JointFace, lattice: Lattice) -> list[Float32Array]:
    """Return what a face covers, sends and gets, by the first row and column met.

    (by rows, by columns, rows, columns), or (1, 1, 1) of what is even.
    """
    light = np.ones((1, 1), dtype=np.float32) if face.light is None else face.light
    sends = face.sends
    if face.joins_light and face.light is not None:
        sends = sends * face.light
    return [
        np.lib.stride_tricks.sliding_window_view(values, lattice.shape)
        if _varies(values)
        else values[:1, :1, None]
        for values in (face.covers, sends, light)
    ]


def _met_by(
    face: JointFace,
    views: Sequence[Float32Array],
    rays: FloatArray,
    lattice: Lattice,
) -> list[Float32Array]:
    """Return what a bundle of rays meets, (rays, rows, columns), or one."""
    by = (face.covers.shape[0] - lattice.shape[0]) // 2
    at = face.z_um / lattice.step_um * rays.T * np.array([[1.0], [-1.0]]) + by
    if face.is_sharp or by > _CLOSE:
        column, row = np.rint(at).astype(np.intp)
        return [v if v.ndim == 3 else np.asarray(v[row, column]) for v in views]
    column, row = np.floor(at).astype(np.intp)
    right, down = (at - np.floor(at)).astype(np.float32)[:, :, None, None]
    return [
        v
        if v.ndim == 3
        else (1 - down) * ((1 - right) * v[row, column] + right * v[row, column + 1])
        + down * ((1 - right) * v[row + 1, column] + right * v[row + 1, column + 1])
        for v in views
    ]
