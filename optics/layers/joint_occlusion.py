"""Joint effect of bodies far from focus: means of products, by rays on a lattice.

Of the rays from one point of the image those that pass one body out of focus meet other
parts of the next one than those that do not. The mean of a product is not that of the
means then. The difference is smooth where all of them are far from focus; what lies
near focus multiplies it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from microplan.arrays import Float32Array, FloatArray
from microplan.optics.layers.lattice import Lattice, blur
from microplan.optics.layers.met_faces import JointFace, MetFace, varies
from microplan.optics.layers.rays import slopes
from microplan.optics.transfer.microscope import Microscope

# Rays a point, as many as the time allows: the errors of means fall nearly with their
# number (`benchmarks/optics/shading.py`).
_FEWEST, _MOST, _SAMPLES = 64, 1024, 1 << 21
_FINEST = 2.0  # points: what is smaller is no mean
WIDEST = 300  # points aside that a ray may meet a face: a limit to memory
_AT_ONCE = 1 << 16  # values of one array: they stay in the cache


@dataclass(frozen=True, slots=True, kw_only=True)
class JointResidual:
    """Residuals of blending on a lattice, by what they are multiplied with."""

    above: FloatArray  # (rows, columns): of what lies above all that is sharp
    # of the light that leaves each sharp face for a reflectance of 1, the lowest first
    sharp: tuple[FloatArray, ...]
    below: FloatArray  # of what lies below, where nothing sharp hides it


AnyFloats = FloatArray | Float32Array


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
    finer: float = 1.0,
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
    finer : float
        As `microplan.optics.render.sampling.Sampling.rays`: below 1 there are fewer.
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
    rays = rays or _rays(lattice, min(finer, 1.0))
    c, s = math.cos(spin_rad), math.sin(spin_rad)
    tangents = slopes(microscope, rays) @ np.array([[c, s], [-s, c]])
    faces = [_softened(face, lattice, microscope, rays) for face in faces]
    met = [MetFace.of(face, tangents, lattice) for face in faces]
    change = list(_residuals(met, len(tangents), lattice))
    if diffracts:
        # as in `microplan.optics.layers.occlusion`: what meets in focus is cut off
        # before it diffracts
        change = list(blur(np.stack(change), lattice.step_um, microscope, "exact", 0.0))
    below, *sharp, above = change
    return JointResidual(above=above, sharp=tuple(sharp), below=below)


def _rays(lattice: Lattice, finer: float) -> int:
    """Return how many rays a point gets on a lattice."""
    rows, columns = lattice.shape
    # what few of them leave of trials' images is less than rays past walls do
    share = max(math.floor(_SAMPLES * finer**3 / (rows * columns)), 1)
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
    hiding = sum(not f.is_sharp and varies(f.covers) for f in faces)
    # what sends light hides with the same coverage
    sending = sum(
        not f.is_sharp and not varies(f.covers) and varies(f.sends) for f in faces
    )
    images = sum(varies(image.covers) for f in faces for image in f.images)
    return hiding + sending + images + sum(f.light is not None for f in faces)


def _softened(
    face: JointFace, lattice: Lattice, microscope: Microscope, rays: int
) -> JointFace:
    """Return a face averaged over squares as large as a ray's share of the pupil.

    A ray stands for a cell of the pupil, whose side is sqrt(pi / rays) of its radius.
    """
    if face.images:
        images = (_softened(each, lattice, microscope, rays) for each in face.images)
        face = replace(face, images=tuple(images))
    if face.is_sharp:
        return face
    reach_um = microscope.blur_diameter_um(face.z_um) / 2
    size = math.sqrt(math.pi / rays) * reach_um / lattice.step_um
    return replace(
        face, covers=_boxed(face.covers, size), sends=_boxed(face.sends, size)
    )


def _boxed(values: Float32Array, size: float) -> Float32Array:
    """Return means over squares of an odd number of points near `size`."""
    if size < _FINEST or not varies(values):
        return values
    odd = 2 * round((size - 1) / 2) + 1
    found: Float32Array = ndimage.uniform_filter(values, odd, mode="nearest")
    return found


def _residuals(met: Sequence[MetFace], rays: int, lattice: Lattice) -> FloatArray:
    """Return fields of means less fields of their faces' means, (N, rows, columns).

    As many rays or rows at once as the cache holds.
    """
    rows, columns = lattice.shape
    band = max(1, min(rows, _AT_ONCE // columns))
    bundle = max(1, _AT_ONCE // (band * columns))
    fields = 2 + sum(face.is_sharp for face in met)
    counts = [3 + (1 + len(face.images) if face.images else 0) for face in met]
    sums = np.zeros((fields + sum(counts), rows, columns), dtype=np.float32)
    for top in range(0, rows, band):
        part = slice(top, min(top + band, rows))
        for first in range(0, rays, bundle):
            some = slice(first, min(first + bundle, rays))
            parts = [each.met(some, part) for each in met]
            every = [*_composite(met, parts), *itertools.chain(*parts)]
            for out, each in zip(sums[:, part], every, strict=True):
                _add(out, each, some.stop - some.start)
    means = sums.astype(np.float64) / rays
    alone = [list(part) for part in np.split(means[fields:], np.cumsum(counts)[:-1])]
    found = zip(means[:fields], _composite(met, alone), strict=True)
    return np.array([mean - field for mean, field in found])


def _add(sums: Float32Array, values: AnyFloats, rays: int) -> None:
    """Add up what a bundle of rays meets; what is even stands for all of them."""
    if values.size > 1:
        sums += values[0] if rays == 1 else values.sum(axis=0)
    elif values.item() != 0:
        sums += rays * values.reshape(())


def _composite(
    faces: Sequence[MetFace], parts: Sequence[Sequence[AnyFloats]]
) -> list[AnyFloats]:
    """Return the fields of faces, each hiding those below: of rays, or of means.

    Below all that is sharp, of each sharp face, above.
    """
    nothing: AnyFloats = np.zeros((1,) * parts[0][0].ndim, dtype=np.float32)
    found: list[AnyFloats] = []
    current = nothing
    for face, (free, sends, light, *mirror) in zip(faces, parts, strict=True):
        if face.is_sharp:
            leaves = _mirrored_too(face, light, mirror[1:])
            found = [*found, leaves] if found else [current, leaves]
            current = nothing
            continue
        found = [each * free for each in found]
        sent = sends if face.sends_all else sends * light
        if mirror:
            unlit, *images = mirror
            sent = _mirrored_too(face, sent, [unlit, *images])
        current = _covered(current, free, sent, of_covered=face.of_covered)
    return [*found, current] if found else [current, nothing]


def _covered(
    current: AnyFloats, free: AnyFloats, sent: AnyFloats, *, of_covered: bool
) -> AnyFloats:
    """Return what is seen of a field past a face, and the face's own."""
    if of_covered and free.size == 1 and free.item() == 0:
        return sent
    if of_covered:
        return _into(np.add, _into(np.multiply, current - sent, free), sent)
    return _into(np.add, current * free, sent)


def _into(made: np.ufunc, one: AnyFloats, other: AnyFloats) -> AnyFloats:
    """Return what is made of a field, written over it where it is large enough."""
    found: AnyFloats = made(one, other, out=one if one.size >= other.size else None)
    return found


def _mirrored_too(
    face: MetFace, dull: AnyFloats, mirrored: Sequence[AnyFloats]
) -> AnyFloats:
    """Return what a face gives back as dull, and the product of what it mirrors."""
    if not mirrored:
        return dull
    return (1 - face.finish) * dull + face.finish * math.prod(
        mirrored[1:], start=mirrored[0]
    )
