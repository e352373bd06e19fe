"""Sums over rays against faces laid over each other ray by ray."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from microplan.arrays import BoolArray, Float32Array, FloatArray
from microplan.optics.layers.joint.joint_faces import (
    JointFace,
    MetFace,
    PackedFaces,
)
from microplan.optics.layers.joint.joint_occlusion import met_lattice
from microplan.optics.layers.joint.ray_sums import residuals
from microplan.optics.layers.lattice import Lattice
from microplan.optics.layers.rays import slopes
from tests.optics.shapes import microscope

RAYS = 40
LATTICE = Lattice.over((-40.0, -9.0, 140.0, 9.0), 1.0)  # rows of two runs


def face(
    rng: np.random.Generator, z_um: float, *, even: bool = False, **kind: Any
) -> JointFace:
    """Return a face of random values on the points that rays meet."""
    points = met_lattice(LATTICE, microscope(), z_um, RAYS)

    def values() -> Float32Array:
        return rng.random(points.shape).astype(np.float32)

    covers = values()
    sends = np.float32(0.5) * covers if even else values()
    return JointFace(
        z_um=z_um, lattice=points, covers=covers, sends=sends, light=values(), **kind
    )


def scene(rng: np.random.Generator) -> list[JointFace]:
    """Return faces of all kinds, the lowest first."""
    none = np.zeros(LATTICE.grown(9).shape, dtype=np.float32)
    sharp = JointFace(
        z_um=0.0, lattice=LATTICE.grown(9), covers=none, sends=none, is_sharp=True,
        finish=0.4, images=(face(rng, -60.0),),
    )  # fmt: skip
    return [
        face(rng, -90.0, finish=0.3, images=(face(rng, -170.0), face(rng, -210.0))),
        face(rng, -5.0, even=True),
        sharp,
        face(rng, 12.0, joins_light=True),
        face(rng, 80.0, even=True),
    ]


def run(values: Float32Array, y: float, x: float) -> FloatArray:
    """Return values at the lattice's points from a row and column on."""
    if values.size == 1:
        return np.full(LATTICE.shape, float(values.item()))
    (rows, columns), row, column = LATTICE.shape, math.floor(y), math.floor(x)
    part = values[row : row + rows + 1, column : column + columns + 1].astype(float)
    part = np.pad(
        part, ((0, rows + 1 - part.shape[0]), (0, columns + 1 - part.shape[1]))
    )
    v, u = y - row, x - column
    lines = (1 - v) * part[:-1] + v * part[1:]
    return (1 - u) * lines[:, :-1] + u * lines[:, 1:]


def composite(
    faces: Sequence[MetFace], parts: Sequence[Sequence[FloatArray]]
) -> list[FloatArray]:
    """Return what is seen of faces over each other, the lowest first.

    Below all that is sharp, of each sharp face, above.
    """
    found: list[FloatArray] = []
    current = np.zeros(LATTICE.shape)
    for face, (free, sends, light, *mirror) in zip(faces, parts, strict=True):
        if face.is_sharp:
            leaves = mirrored_too(face, light, mirror[1:])
            found = [*found, leaves] if found else [current, leaves]
            current = np.zeros(LATTICE.shape)
            continue
        found = [each * free for each in found]
        sent = mirrored_too(face, sends if face.sends_all else sends * light, mirror)
        current = (current - sent if face.of_covered else current) * free + sent
    return [*found, current] if found else [current, np.zeros(LATTICE.shape)]


def mirrored_too(
    face: MetFace, dull: FloatArray, mirrored: Sequence[FloatArray]
) -> FloatArray:
    if not mirrored:
        return dull
    mirrors: FloatArray = np.prod(mirrored, axis=0)
    return (1 - face.finish) * dull + face.finish * mirrors


def residual(met: Sequence[MetFace], wanted: BoolArray | None = None) -> FloatArray:
    packed = PackedFaces.of(met)
    found = np.full((2 + sum(each.is_sharp for each in met), *LATTICE.shape), np.nan)
    residuals(
        packed.values, packed.fields, packed.down, packed.right, packed.is_between,
        packed.faces, packed.finish,
        np.zeros((0, 0), dtype=np.bool_) if wanted is None else wanted, found,
    )  # fmt: skip
    return found


@pytest.mark.parametrize("seed", range(4))
def test_residuals_are_those_of_faces_laid_ray_by_ray(seed: int) -> None:
    """Sharp faces, mirrors, light and reflectance that vary, rays between points."""
    rng = np.random.default_rng(seed)
    tangents = slopes(microscope(), RAYS)
    faces = [each for each in scene(rng) if seed < 2 or not each.is_sharp]
    met = [MetFace.of(each, tangents, LATTICE) for each in faces]
    rays = [
        [
            [
                run(field, place.down[ray], place.right[ray])
                for field, place in zip(each.fields, each.places, strict=True)
            ]
            for each in met
        ]
        for ray in range(RAYS)
    ]
    seen = np.mean([composite(met, parts) for parts in rays], axis=0)
    means = [
        list(np.mean([parts[k] for parts in rays], axis=0)) for k in range(len(met))
    ]
    places = [place for each in met for place in each.places]
    assert {bool(each.is_between) for each in places} == {False, True}
    expected = seen - np.array(composite(met, means))
    np.testing.assert_allclose(residual(met), expected, rtol=0, atol=2e-6)


def test_where_it_is_wanted_a_residual_is_as_if_it_were_all_over() -> None:
    rng = np.random.default_rng(5)
    met = [MetFace.of(each, slopes(microscope(), RAYS), LATTICE) for each in scene(rng)]
    wanted = np.zeros(LATTICE.shape, dtype=np.bool_)
    wanted[2:5, 70:90], wanted[-1, -1] = True, True
    part, whole = residual(met, wanted), residual(met)
    np.testing.assert_allclose(part[:, wanted], whole[:, wanted], rtol=0, atol=2e-6)
    assert (part == 0).mean() > 0.3
