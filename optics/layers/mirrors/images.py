"""Mirror images of what stands above a mirror face.

A ray that leaves a mirror at height z came in with the mirrored slope: what it passed
on the way down at height h it seems to pass at 2 z - h, below the mirror. Along each
lit ray light comes from the lamp alone, so that images of higher bodies are black.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.joint.joint_faces import JointFace
from microplan.optics.layers.joint.joint_occlusion import met_lattice
from microplan.optics.layers.lattice import Lattice
from microplan.optics.layers.wide_blur import cover_few
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer, Window
from microplan.optics.transfer.microscope import Microscope

Images = tuple[tuple[Layer, ...], ...]  # by height, the nearest to the mirror first


def mirror_images(layers: Sequence[Layer], z_um: float) -> Images:
    """Return the images of all layers above a mirror at a world height."""
    above = sorted(
        (layer for layer in layers if layer.z_um > z_um), key=lambda la: la.z_um
    )
    groups = itertools.groupby(above, key=lambda layer: layer.z_um)
    return tuple(
        tuple(
            replace(layer, z_um=2 * z_um - height_um, underside_um=None)
            for layer in group
        )
        for height_um, group in groups
    )


def free_of_images(
    images: Images,
    microscope: Microscope,
    *,
    focus_um: float,
    model: str,
    window: Window,
    shift_um: tuple[float, float],
    sampling: Sampling,
) -> FloatArray:
    """Return what blurred images leave of a mirror's light, (rows, columns), 0..1.

    At the pixels; the product over heights. Arguments as in
    `microplan.optics.render.render.render`.
    """
    share = np.ones((window.rows, window.columns))
    for group in images:
        found = cover_few(
            group, microscope, focus_um=focus_um, model=model, window=window,
            shift_um=shift_um, sampling=sampling,
        )  # fmt: skip
        share *= 1 - np.clip(np.sum([c.coverage for c in found], axis=0), 0.0, 1.0)
    return share


def image_faces(
    images: Images,
    lattice: Lattice,
    microscope: Microscope,
    focus_um: float,
    rays: int,
    finer: float,
) -> tuple[JointFace, ...]:
    """Return images as black faces where rays from a lattice's points meet them.

    There are so many `rays` a point; `finer`: as in `Lattice.covered`.
    """
    found = []
    for group in images:
        z_um = group[0].z_um - focus_um
        points = met_lattice(lattice, microscope, z_um, rays)
        free = np.ones(points.shape, dtype=np.float32)
        for layer in group:
            free *= 1 - points.covered(layer, finer)
        found.append(
            JointFace(
                z_um=z_um,
                lattice=points,
                covers=1 - free,
                sends=np.zeros_like(free),
            )
        )
    return tuple(found)
