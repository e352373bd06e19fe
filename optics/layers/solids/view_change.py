"""What walls change of an image: solid less flat bodies, and mirrored rays.

Flat faces are blended, and what they hide together is added. A body of some thickness
hides more: rays that pass beside its top rim meet the wall. That is smooth, but at the
edges of what is near focus, which multiply it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from microplan.arrays import Float32Array, FloatArray
from microplan.optics.layers.joint.joint_occlusion import JointResidual
from microplan.optics.layers.lattice import Lattice, continued
from microplan.optics.layers.solids.mirrored_rays import first_met, mirrored, raised
from microplan.optics.layers.solids.sight import Sight
from microplan.optics.layers.solids.solid_bodies import (
    SentLight,
    SolidFace,
    bands,
    mirrored_rays,
    rays_from,
    rays_moved,
    rays_outside,
    straight_rays,
)
from microplan.optics.layers.solids.straight_rays import Rays, ThickBody
from microplan.optics.layers.solids.unfolded_bodies import free_of, unfolded
from microplan.optics.transfer.microscope import Microscope

_ROUNDING_UM = 1e-6  # heights this close are one
# What layers near focus hide, or show, of a field is left out of trials from so many
# points off their edges: a spline feels 2 - sqrt(3) of a value less a point.
_BEYOND = 4
# Powers of `finer` that are left of rays: straight ones, which take the least time for
# what they leave, and those that walls mirror above focus and below.
_STRAIGHT, _ABOVE, _BELOW = 3, 5, 4


def solid_view(
    faces: Sequence[SolidFace],
    plane: SentLight | None,
    plane_um: float,
    lattice: Lattice,
    microscope: Microscope,
    *,
    finer: float = 1.0,
) -> tuple[JointResidual, FloatArray]:
    """Return what walls change of an image, and what bodies in the plane in focus cut.

    Both on the points of a lattice. Where the plane in focus lies in a body, the first
    is continued from beside it: it is smooth then. The second, (rows, columns), is what
    comes from below all that is sharp to be taken off there.

    Parameters
    ----------
    faces : sequence of SolidFace
        The lowest first, heights from focus.
    plane : SentLight, optional
        Of the plane below everything, `plane_um` from focus.
    lattice : Lattice
        Points in the plane in focus.
    finer : float
        As in `solid_bodies.rays_from`.
    """
    count = straight_rays(lattice, finer, _STRAIGHT)
    parts = [
        _solid_and_flat(faces, plane, plane_um, *rays_from(band, microscope, count))
        for band in bands(lattice, count)
    ]
    solid, flat = (_joined(each, lattice) for each in zip(*parts, strict=True))
    below, *sharp, above = (one - other for one, other in zip(solid, flat, strict=True))
    return JointResidual(above=above, sharp=tuple(sharp), below=below), solid[0]


def _solid_and_flat(
    faces: Sequence[SolidFace],
    plane: SentLight | None,
    plane_um: float,
    rays: Rays,
    soft: float,
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return the fields that rays see, (points,) each: of solid bodies, of faces."""
    sight = Sight(rays=rays, soft=soft)
    solid, flat = (
        _straight(faces, plane, plane_um, sight, walls=walls) for walls in (True, False)
    )
    through = [face.body for face in faces if is_cut(face.body)]
    moved, beside = rays_moved(through, rays)
    if moved.size:
        sight = Sight(rays=beside, soft=soft)
        outside = _straight(faces, plane, plane_um, sight, walls=True)
        for field, own in zip(solid[:-1], outside[:-1], strict=True):
            field[moved] = own
    return solid, flat


def is_cut(body: ThickBody) -> bool:
    """Return whether the plane in focus lies in a body, between its faces."""
    return not body.is_sharp and body.under_um < 0 < body.top_um


def mirrored_view(
    faces: Sequence[SolidFace],
    plane: SentLight | None,
    plane_um: float,
    lattice: Lattice,
    microscope: Microscope,
    *,
    finer: float = 1.0,
) -> JointResidual:
    """Return what rays add to an image that walls mirror above the plane in focus.

    Arguments as in `solid_view`; means over the cells of the lattice. What lies as high
    as the plane in focus is in focus in a vertical mirror, too: points are closer than
    for what is lost at walls. With it comes what sharp mirror faces send up to walls.
    """
    count = mirrored_rays(lattice, finer, _ABOVE)
    margin_um = _margin_um(lattice, finer)
    parts = [
        _mirrored_above(faces, plane, plane_um, rays, margin_um)
        for rays in _cell_rays(lattice, microscope, count, finer)
    ]
    above, *sharp = (continued(f) / count for f in _joined(parts, lattice))
    below = np.zeros(lattice.shape)
    return JointResidual(above=above, sharp=tuple(sharp), below=below)


def _joined(
    parts: Sequence[Sequence[FloatArray]], lattice: Lattice
) -> list[FloatArray]:
    """Return fields, (rows, columns) each, of bands of a lattice."""
    return [
        np.concatenate(field).reshape(lattice.shape)
        for field in zip(*parts, strict=True)
    ]


def _cell_rays(
    lattice: Lattice, microscope: Microscope, count: int, finer: float
) -> Iterator[Rays]:
    """Yield so many rays of each point of a lattice, all over its cell, by bands."""
    for band in bands(lattice, count):
        rays, _ = rays_from(band, microscope, count, all_over=True, finer=finer)
        yield rays


def _margin_um(lattice: Lattice, finer: float) -> float:
    """Return how far beyond where they are seen fields are found."""
    return math.inf if finer >= 1 else _BEYOND * lattice.step_um


def _mirrored_above(
    faces: Sequence[SolidFace],
    plane: SentLight | None,
    plane_um: float,
    rays: Rays,
    margin_um: float,
) -> list[FloatArray]:
    """Return sums of rays, (points,): above the plane in focus, and of sharp faces.

    The latter are nan farther from the face than a margin.
    """
    bodies = [face.body for face in faces]
    low_um = min([0.0, *(body.top_um for body in bodies if body.is_sharp)])
    above = np.zeros(rays.x_um.shape[0])
    near = [face for face in faces if face.body.is_sharp]
    if all(b.top_um <= low_um or b.wall_reflectance == 0 for b in bodies):
        return [above, *(np.zeros_like(above) for _ in near)]
    met = first_met(bodies, low_um, rays)
    ends = _ends(faces, plane, plane_um)
    above += mirrored(bodies, *ends, rays, met, above_um=max(plane_um, 0.0))
    for face in faces:
        if not face.body.is_sharp and face.body.top_um > 0:
            above += raised(bodies, face.body, face.sends.mirrors, rays, met)
    # for a reflectance of 1
    mirrors = [face.sends.finish if face.sends.mirrors > 0 else 0.0 for face in near]
    if not any(mirrors):
        return [above, *(np.zeros_like(above) for _ in near)]
    moved, beside = rays_moved([body for body in bodies if is_cut(body)], rays)
    if moved.size:
        again = first_met(bodies, low_um, beside)
        met.z_um[moved], met.walls[moved] = again.z_um, again.walls
        rays = rays.with_some(moved, beside)
    sharp = []
    for face, each in zip(near, mirrors, strict=True):
        seen = np.flatnonzero(face.body.distance.at(*rays.first) < margin_um)
        field = np.full_like(above, np.nan)
        own = rays.some(seen), met.some(seen)
        field[seen] = raised(bodies, face.body, each, *own)
        sharp.append(field)
    return [above, *sharp]


def mirrored_below(
    faces: Sequence[SolidFace],
    plane: SentLight | None,
    plane_um: float,
    lattice: Lattice,
    microscope: Microscope,
    *,
    finer: float = 1.0,
) -> FloatArray:
    """Return what rays add to an image that meet their first wall below focus.

    (rows, columns) on the points of a lattice, where nothing sharp hides it. Arguments
    as in `solid_view`: all that is seen is out of focus, and smooth as what is lost at
    walls.
    """
    count = mirrored_rays(lattice, finer, _BELOW)
    margin_um = _margin_um(lattice, finer)
    sharp = [face.body for face in faces if face.body.is_sharp]
    parts = []
    for rays in _cell_rays(lattice, microscope, count, finer):
        free = np.ones(rays.shape[0], dtype=np.bool_)
        for body in sharp:
            free &= body.distance.at(*rays.first) > -margin_um
        found, seen = np.full(free.shape, np.nan), np.flatnonzero(free)
        found[seen] = _mirrored_below(faces, plane, plane_um, rays.some(seen))
        parts.append([found])
    (found,) = _joined(parts, lattice)
    return continued(found) / count


def _mirrored_below(
    faces: Sequence[SolidFace], plane: SentLight | None, plane_um: float, rays: Rays
) -> FloatArray:
    """Return sums of rays, (points,), that meet their first wall below focus."""
    bodies = [face.body for face in faces]
    outside = rays_outside([body for body in bodies if body.is_sharp], rays)
    met = first_met(bodies, plane_um, outside)
    ends = _ends(faces, plane, plane_um)
    found = mirrored(bodies, *ends, outside, met, below_um=0.0)
    for face in faces:
        if not face.body.is_sharp and face.body.top_um <= 0:
            found += raised(bodies, face.body, face.sends.mirrors, outside, met)
    return found


def _ends(
    faces: Sequence[SolidFace], plane: SentLight | None, plane_um: float
) -> tuple[list[SentLight], SentLight | None, float]:
    """Return what ends rays: faces, the plane below everything and its height."""
    return [face.sends for face in faces], plane, plane_um


def _straight(
    faces: Sequence[SolidFace],
    plane: SentLight | None,
    plane_um: float,
    sight: Sight,
    *,
    walls: bool,
) -> list[FloatArray]:
    """Return the fields that rays see without a mirror, (points,) means each."""
    bodies = [face.body for face in faces]
    sharp = [body for body in bodies if body.is_sharp]
    split_um = sharp[0].top_um if sharp else -math.inf
    below, above = np.zeros((2, sight.rays.x_um.size))
    between = []
    lowest = [body for body in bodies if body.top_um <= plane_um + _ROUNDING_UM]

    @cache
    def free_at(z_um: float) -> Float32Array:
        higher = [body for body in bodies if body.top_um > z_um]
        return _free(higher, z_um, sight, walls=walls)

    @cache
    def mirrored_at(z_um: float) -> Float32Array:
        images = unfolded(bodies, z_um)
        return free_of(images, sight.rays, sight.soft, walls=walls)

    def sent_at(z_um: float, sends: SentLight) -> Float32Array:
        found = sight.sent(sends, z_um)
        if sends.mirrors > 0:
            found = found + np.float32(sends.mirrors) * mirrored_at(z_um)
        return found

    if plane is not None and plane.reflectance > 0:
        free = free_at(max([plane_um, *(body.top_um for body in lowest)]))
        for body in lowest:
            free = free * (1 - sight.covers(body))
        sent = free * sight.sent(plane, plane_um)
        below += sent.mean(axis=1, dtype=np.float64)
    for face in faces:
        z_um = face.body.top_um
        free = free_at(z_um)
        if face.body.is_sharp:
            unit = replace(face.sends, reflectance=1.0)
            sent = free * sent_at(z_um, unit)
            between.append(sent.mean(axis=1, dtype=np.float64))
        elif face.sends.reflectance > 0:
            sent = free * sight.covers(face.body) * sent_at(z_um, face.sends)
            field = below if z_um < split_um else above
            field += sent.mean(axis=1, dtype=np.float64)
    return [below, *between, above]


def _free(
    bodies: Sequence[ThickBody], z_um: float, sight: Sight, *, walls: bool
) -> Float32Array:
    """Return what bodies leave of each ray on its way to a height.

    Tops near focus are left out: they hide the same of all rays.
    """
    shape = sight.rays.x_um.shape[0], sight.rays.across.shape[1]
    found = np.ones(shape, dtype=np.float32)
    for body in bodies:
        low_um = max(body.under_um, z_um)
        if walls and low_um < body.top_um:
            found *= 1 - sight.hides(body, low_um)
        elif not body.is_sharp:
            found *= 1 - sight.covers(body)
    return found
