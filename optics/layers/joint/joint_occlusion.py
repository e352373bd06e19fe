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

from microplan.arrays import BoolArray, Float32Array, FloatArray
from microplan.optics.layers.joint.joint_faces import (
    JointFace,
    MetFace,
    PackedFaces,
    varies,
)
from microplan.optics.layers.lattice import Lattice, blur
from microplan.optics.layers.rays import slopes
from microplan.optics.transfer.microscope import Microscope

# Rays a point, as many as the time allows: the errors of means fall nearly with their
# number (`benchmarks/optics/shading.py`).
_FEWEST, _MOST, _SAMPLES = 64, 1024, 1 << 21
# of trials' images: the fewest a point, where all points have so many together
_THINNED, _ENOUGH = 16, 3 << 19
_FINEST = 2.0  # points: what is smaller is no mean
_A_RAY = 5.0  # points of a face in the side of a ray's share of the pupil
_COARSEST = 32.0  # steps of the lattice between them
WIDEST = 300  # points aside that a ray may meet a face: a limit to memory


@dataclass(frozen=True, slots=True, kw_only=True)
class JointResidual:
    """Residuals of blending on a lattice, by what they are multiplied with."""

    above: FloatArray  # (rows, columns): of what lies above all that is sharp
    # of the light that leaves each sharp face for a reflectance of 1, the lowest first
    sharp: tuple[FloatArray, ...]
    below: FloatArray  # of what lies below, where nothing sharp hides it


def ray_count(lattice: Lattice, finer: float) -> int:
    """Return how many rays a point of a lattice gets, a power of two.

    `finer` as `microplan.optics.render.sampling.Sampling.rays`: below 1 they are fewer.
    """
    rows, columns = lattice.shape
    # what few of them leave of trials' images is less than rays past walls do
    few = min(finer, 1.0) ** 3
    share = math.floor(_SAMPLES * few / (rows * columns))
    enough = _ENOUGH // (rows * columns) if finer < 1 else _FEWEST
    fewest = min(max(enough, _THINNED), _FEWEST)
    return int(1 << (min(max(share, fewest), _MOST).bit_length() - 1))


def met_lattice(
    lattice: Lattice,
    microscope: Microscope,
    z_um: float,
    rays: int,
    *,
    finest_um: float = math.inf,
) -> Lattice:
    """Return the points on which a face `z_um` out of focus is met by rays.

    They start from a lattice, so many from each of its points: the points need to be no
    closer than a ray is wide, or than what varies most on the face (`finest_um`).
    """
    apart_um = min(_width_um(microscope, z_um, rays) / _A_RAY, finest_um)
    wide = apart_um / lattice.step_um
    step = lattice.step_um * 2 ** math.floor(math.log2(min(max(wide, 1.0), _COARSEST)))
    (left, top), (rows, columns) = lattice.corner_um, lattice.shape
    reach = microscope.blur_diameter_um(z_um) / 2
    area = (
        left - reach, top - (rows - 1) * lattice.step_um - reach,
        left + (columns - 1) * lattice.step_um + reach, top + reach,
    )  # fmt: skip
    return Lattice.over(area, step, more=0)


def _width_um(microscope: Microscope, z_um: float, rays: int) -> float:
    """Return the side of what one ray stands for at a height.

    A cell of the pupil, whose side is sqrt(pi / rays) of its radius.
    """
    return math.sqrt(math.pi / rays) * microscope.blur_diameter_um(z_um) / 2


def joint_residual(
    faces: Sequence[JointFace],
    lattice: Lattice,
    microscope: Microscope,
    *,
    rays: int,
    spin_rad: float = 0.0,
    diffracts: bool = True,
    wanted: BoolArray | None = None,
) -> JointResidual | None:
    """Return the residual of blending faces, on the points of a lattice.

    Parameters
    ----------
    faces : sequence of JointFace
        The lowest first; sharp ones in one run.
    lattice : Lattice
        Points in the plane in focus.
    rays : int
        Of each point, see `ray_count`.
    spin_rad : float
        By which their pattern is turned: what two patterns differ by is its error.
    diffracts : bool
        Whether it is seen by the lens, and averaged over pixels.
    wanted : (rows, columns) bool array, optional
        Points where it is, the lens' reach about them in. Default: all.

    Returns
    -------
    JointResidual or None
        Shares of full scale, to be added to faces blended with each's coverage times
        the blurred light on it. None where no two of them are uneven: there is none.
    """
    faces = _not_hidden(faces)
    if _uneven(faces) < 2:
        return None
    c, s = math.cos(spin_rad), math.sin(spin_rad)
    tangents = slopes(microscope, rays) @ np.array([[c, s], [-s, c]])
    soft = [_softened(face, microscope, rays) for face in faces]
    met = [MetFace.of(face, tangents, lattice) for face in soft]
    change = _residuals(met, lattice, wanted)
    if diffracts:
        # as in `microplan.optics.layers.occlusion`: what meets in focus is cut off
        # before it diffracts
        uneven = change.any(axis=(1, 2))
        if uneven.any():
            change[uneven] = blur(
                change[uneven], lattice.step_um, microscope, "exact", 0.0
            )
    below, *sharp, above = change
    return JointResidual(above=above, sharp=tuple(sharp), below=below)


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


def _softened(face: JointFace, microscope: Microscope, rays: int) -> JointFace:
    """Return a face averaged over squares as large as a ray is wide there."""
    if face.images:
        images = (_softened(each, microscope, rays) for each in face.images)
        face = replace(face, images=tuple(images))
    if face.is_sharp:
        return face
    size = _width_um(microscope, face.z_um, rays) / face.lattice.step_um
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


def _residuals(
    met: Sequence[MetFace], lattice: Lattice, wanted: BoolArray | None
) -> FloatArray:
    """Return fields of means less fields of their faces' means, (N, rows, columns)."""
    from microplan.optics.layers.joint import ray_sums  # loads a compiler

    packed = PackedFaces.of(met)
    found = np.empty((2 + sum(face.is_sharp for face in met), *lattice.shape))
    ray_sums.residuals(
        packed.values, packed.fields, packed.down, packed.right, packed.is_between,
        packed.faces, packed.finish,
        np.zeros((0, 0), dtype=np.bool_) if wanted is None else wanted, found,
    )  # fmt: skip
    return found
