"""Sums over rays against faces laid over each other ray by ray."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from microplan.arrays import Float32Array, FloatArray
from microplan.optics.layers.joint.joint_faces import (
    JointFace,
    MetFace,
    PackedFaces,
    composite,
)
from microplan.optics.layers.joint.joint_occlusion import met_lattice
from microplan.optics.layers.joint.ray_sums import ray_sums
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


@pytest.mark.parametrize("seed", range(4))
def test_sums_are_those_of_faces_laid_ray_by_ray(seed: int) -> None:
    """Sharp faces, mirrors, light and reflectance that vary, rays between points."""
    rng = np.random.default_rng(seed)
    tangents = slopes(microscope(), RAYS)
    faces = [each for each in scene(rng) if seed < 2 or not each.is_sharp]
    met = [MetFace.of(each, tangents, LATTICE) for each in faces]
    packed = PackedFaces.of(met)
    seen = 2 + sum(each.is_sharp for each in faces)
    sums = np.empty((seen + len(packed.fields), *LATTICE.shape))
    ray_sums(
        packed.values, packed.fields, packed.down, packed.right, packed.is_between,
        packed.faces, packed.finish, sums,
    )  # fmt: skip
    plain = np.zeros_like(sums)
    for ray in range(RAYS):
        parts = [
            [
                run(field, place.down[ray], place.right[ray])
                for field, place in zip(each.fields, each.places, strict=True)
            ]
            for each in met
        ]
        plain += [*composite(met, parts), *(field for part in parts for field in part)]
    assert {bool(each) for each in packed.is_between} == {False, True}
    np.testing.assert_allclose(sums / RAYS, plain / RAYS, rtol=0, atol=1e-6)
