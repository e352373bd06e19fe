"""Joint effect of occlusion with shade where both are blurred, by rays on few points.

Of the rays from one point of the image those that pass a higher body meet other parts
of the shade on a lower face than those that do not. The mean of a product is not that
of the means then; the difference is smooth, and traced on the lattice of the
shade.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import numpy.typing as npt

from microplan.arrays import Float32Array, FloatArray
from microplan.optics.layers.coaxial_light import Irradiance
from microplan.optics.layers.lattice import Lattice, blur
from microplan.optics.layers.rays import slopes
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Microscope

_RAYS = 64  # a point: `benchmarks/optics/shading.py` measures the rest
_AT_ONCE = 1 << 16  # values of one array: they stay in the cache


@dataclass(frozen=True, slots=True, kw_only=True)
class _Face:
    """All layers of one height, on a lattice wider than the image's by their blur."""

    height_um: float  # in the world
    z_um: float  # from focus
    covers: Float32Array
    sends: Float32Array  # reflectance times coverage
    dark: Float32Array | None  # the share of light that is kept off; None: nothing


def joint_shading_residual(
    layers: Sequence[Layer],
    background: tuple[float, float] | None,
    found: Mapping[float, Irradiance],
    lattice: Lattice,
    microscope: Microscope,
    *,
    focus_um: float,
    known: Collection[float] = (),
) -> FloatArray:
    """Return the residual of blending shaded layers, on the points of a lattice.

    Parameters
    ----------
    background : (reflectance, z_um), optional
        Of the plane below, if it has a height.
    found : mapping of float to Irradiance
        By height, where faces are shaded.
    lattice : Lattice
        Points in the plane in focus.
    focus_um : float
        World height of that plane.
    known : collection of float
        Heights of faces that are blended with the blur of their product with the light.

    Returns
    -------
    (rows, columns) float64 array
        Share of full scale, to be added to layers blended with each's coverage times
        the blurred light on it.
    """
    every = _faces(layers, background, found, lattice, microscope, focus_um)
    faces = _not_hidden([_whole(face, known) for face in every])
    tangents = slopes(microscope, _RAYS)
    rows, columns = lattice.shape
    walk = _ray_by_ray if rows * columns > _AT_ONCE // 2 else _in_bundles
    lost, sums = walk(faces, tangents, lattice)
    means = np.concatenate([lost[None], sums.reshape(-1, rows, columns)])
    means /= len(tangents)
    # as in `microplan.optics.layers.occlusion`: what meets in focus is cut off before
    # it diffracts
    some = [bool(each.min() < each.max()) for each in means]  # what is even stays
    if any(some):
        means[some] = blur(means[some], lattice.step_um, microscope, "exact", 0.0)
    change: FloatArray = -means[0]
    blended = np.zeros(lattice.shape)
    for covers, sends, dark in means[1:].reshape(sums.shape):
        blended = blended * (1 - covers) + sends * dark
    change += blended
    return change


def _in_bundles(
    faces: Sequence[_Face], tangents: FloatArray, lattice: Lattice
) -> tuple[FloatArray, FloatArray]:
    """Return sums over rays: of what faces send past those above, and of each alone.

    (rows, columns) and (faces, 3, rows, columns): covered, sent, kept dark, the last
    two 0 where nothing is dark. As many rays at once as the cache holds.
    """
    rows, columns = lattice.shape
    block = max(1, _AT_ONCE // (rows * columns))
    lost = np.zeros(lattice.shape)
    sums = np.zeros((len(faces), 3, rows, columns))
    views = [_views(face, lattice) for face in faces]
    for first in range(0, len(tangents), block):
        rays = tangents[first : first + block]
        behind = np.zeros((len(rays), rows, columns), dtype=np.float32)
        for face, seen, total in zip(faces, views, sums, strict=True):
            at = _met(face, rays, lattice)
            parts = [_met_by(view, at) for view in seen]
            behind *= 1 - parts[0]
            if face.dark is not None:
                behind += parts[1] * parts[2]
            for k, part in enumerate(parts):
                total[k] += part.sum(axis=0) if len(part) > 1 else len(rays) * part[0]
        lost += behind.sum(axis=0)
    return lost, sums


def _ray_by_ray(
    faces: Sequence[_Face], tangents: FloatArray, lattice: Lattice
) -> tuple[FloatArray, FloatArray]:
    """Return the same for many points: one ray at a time, what is even not at all."""
    lost = np.zeros(lattice.shape)
    behind, part = (np.empty(lattice.shape, dtype=np.float32) for _ in range(2))
    views = [_views(face, lattice) for face in faces]
    met = [_met(face, tangents, lattice) for face in faces]
    for ray in range(len(tangents)):
        empty = True  # nothing is sent so far
        for seen, (down, right) in zip(views, met, strict=True):
            at = down[ray : ray + 1], right[ray : ray + 1]
            covers, *shaded = (_met_by(view, at)[0] for view in seen)
            if not empty:
                np.subtract(1, covers, out=part)
                behind *= part
            if shaded:
                sends, dark = shaded
                np.multiply(sends, dark, out=behind if empty else part)
                if not empty:
                    behind += part
                empty = False
        if not empty:
            lost += behind
    sums = np.zeros((len(faces), 3, *lattice.shape))
    for face, at, total in zip(faces, met, sums, strict=True):
        for k, values in enumerate(_arrays(face)):
            total[k] = _sum_met(values, at, lattice.shape)
    return lost, sums


def _sum_met(
    values: Float32Array,
    at: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]],
    shape: tuple[int, int],
) -> FloatArray | float:
    """Return the sum over rays of what they meet of a face, (rows, columns)."""
    least = values.min()
    if least == values.max():
        return float(least) * at[0].size
    places, count = np.unique(np.stack(at), axis=1, return_counts=True)
    wide, total = values.astype(np.float64), np.zeros(shape)
    for row, column, times in zip(*places, count, strict=True):
        part = wide[row : row + shape[0], column : column + shape[1]]
        total += part if times == 1 else times * part
    return total


def _not_hidden(faces: Sequence[_Face]) -> Sequence[_Face]:
    """Return faces, the lowest first, from the highest that hides all below it on."""
    full = [k for k, face in enumerate(faces) if face.covers.min() == 1]
    return faces[full[-1] :] if full else faces


def _whole(face: _Face, known: Collection[float]) -> _Face:
    """Return a face whose dark is part of what it sends, if that is known."""
    if face.dark is None or face.height_um not in known:
        return face
    return replace(face, sends=face.sends * face.dark, dark=np.ones_like(face.dark))


def _faces(
    layers: Sequence[Layer],
    background: tuple[float, float] | None,
    found: Mapping[float, Irradiance],
    lattice: Lattice,
    microscope: Microscope,
    focus_um: float,
) -> Iterator[_Face]:
    """Yield faces from the lowest shaded one up."""

    @cache  # the plane below may be as high as a layer
    def dark(z_um: float) -> Float32Array | None:
        if z_um not in found:
            return None
        wide = _wide(lattice, microscope, z_um - focus_um)
        return (1 - found[z_um].on(wide)).astype(np.float32)

    if background is not None and background[1] in found:
        yield _face([], background, dark, lattice, microscope, focus_um)
    lowest = min(found)
    ordered = sorted(layers, key=lambda layer: (layer.z_um, layer.name))
    for z_um, group in itertools.groupby(ordered, key=lambda layer: layer.z_um):
        if z_um >= lowest:
            yield _face(list(group), (0.0, z_um), dark, lattice, microscope, focus_um)


def _face(
    layers: Sequence[Layer],
    plane: tuple[float, float],
    dark: Callable[[float], Float32Array | None],
    lattice: Lattice,
    microscope: Microscope,
    focus_um: float,
) -> _Face:
    """Return layers of one height, or the plane below if there are none."""
    reflectance, z_um = plane
    wide = _wide(lattice, microscope, z_um - focus_um)
    even = (0.0, 0.0) if layers else (1.0, reflectance)
    covers, sends = (np.full(wide.shape, each, dtype=np.float32) for each in even)
    for layer in layers:
        own = wide.held_cells(layer)
        free = 1 - own
        covers, sends = covers * free + own, sends * free + layer.reflectance * own
    return _Face(
        height_um=z_um,
        z_um=z_um - focus_um,
        covers=covers,
        sends=sends,
        dark=dark(z_um),
    )


def _wide(lattice: Lattice, microscope: Microscope, z_um: float) -> Lattice:
    """Return the points that rays meet `z_um` out of focus."""
    reach_um = microscope.blur_diameter_um(z_um) / 2
    return lattice.grown(math.ceil(reach_um / lattice.step_um))


def _met(
    face: _Face, tangents: FloatArray, lattice: Lattice
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the first row and column of a face that each bundle of rays meets."""
    by = (face.covers.shape[0] - lattice.shape[0]) // 2
    across, up = np.rint(face.z_um * tangents.T / lattice.step_um).astype(np.intp)
    return by - up, by + across


def _met_by(
    view: Float32Array, at: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]
) -> Float32Array:
    """Return what a bundle of rays meets, (rays, rows, columns); of one no copy.

    Of what is even, (1, 1, 1).
    """
    if view.ndim == 3:
        return view
    if at[0].size == 1:
        return np.asarray(view[at[0].item(), at[1].item()][None])
    return view[at]


def _views(face: _Face, lattice: Lattice) -> list[Float32Array]:
    """Return what a face covers, sends and keeps dark by the first row and column met.

    (by rows, by columns, rows, columns), or (1, 1, 1) of what is even; the first alone
    where nothing is dark.
    """
    return [
        values[:1, :1, None]
        if values.min() == values.max()
        else np.lib.stride_tricks.sliding_window_view(values, lattice.shape)
        for values in _arrays(face)
    ]


def _arrays(face: _Face) -> list[Float32Array]:
    """Return what a face covers, and what it sends and keeps dark if anything is."""
    if face.dark is None:
        return [face.covers]
    return [face.covers, face.sends, face.dark]
