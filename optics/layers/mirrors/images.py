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
from microplan.optics.layers.coaxial_light import area_um, pixel_axes_um
from microplan.optics.layers.joint.joint_faces import JointFace
from microplan.optics.layers.joint.joint_occlusion import met_lattice
from microplan.optics.layers.lattice import Lattice, blur
from microplan.optics.render.render import cover
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer, Window
from microplan.optics.transfer.microscope import Microscope

_A_BLUR = 8  # points in a blur's radius, of trials' images

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
    finer: float,
) -> FloatArray:
    """Return what blurred images leave of a mirror's light, (rows, columns), 0..1.

    At the pixels; the product over heights. Arguments as in
    `microplan.optics.render.render.render`. `finer`: as `Sampling.rays`; below 1 what
    is blurred widely is blurred on points as far apart as that allows.
    """
    axes = pixel_axes_um(microscope, window, shift_um)
    share = np.ones((window.rows, window.columns))
    for group in images:
        away_um = group[0].z_um - focus_um
        step = microscope.blur_diameter_um(away_um) / 2 / _A_BLUR
        if finer < 1 and step > 2 * microscope.um_per_px:
            area = area_um(microscope, window, shift_um, away_um)
            points = Lattice.over(area, step)
            hidden = np.sum([points.covered(layer, finer) for layer in group], axis=0)
            blurred = blur(hidden, step, microscope, model, away_um)
            found = points.read(blurred, *axes)
        else:
            covers = cover(
                group, microscope, focus_um=focus_um, model=model, window=window,
                shift_um=shift_um, sampling=sampling,
            )  # fmt: skip
            found = np.sum([each.coverage for each in covers], axis=0)
        share *= 1 - np.clip(found, 0.0, 1.0)
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
