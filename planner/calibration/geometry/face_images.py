"""Images of a part's faces, one each, and whether any is seen without its edges."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase

# of a face's contrast, as in the middle of a strip of 2.3 Airy radii or a square of 3.5
_WHOLE = 0.9


def face_names(case: LookCase) -> tuple[str, ...]:
    """Return what the faces on a part are called; its own has no name."""
    return tuple(layer.name.rpartition(".")[2] for layer in case.moving[1:])


def face_images(
    case: LookCase, x_um: float = 0.0, y_um: float = 0.0, theta_rad: float = 0.0
) -> FloatArray:
    """Return images of faces, each as bright as the part's; 1 is full scale.

    The part's own with its background, of others what they add where that is alone.

    Parameters
    ----------
    case : LookCase
        Of the region; its moving layers are the part's own face and those on it.
    x_um, y_um, theta_rad : float
        How far the part is off its nominal pose.

    Returns
    -------
    (F, rows, columns) float array
        The part's own first.
    """
    pose = {"dx_um": x_um, "dy_um": y_um, "theta_rad": theta_rad}
    found = np.array([nominal_render(each)(**pose) for each in _alone(case)])
    found[1:] -= case.light.gain * case.background
    return found


def _alone(case: LookCase) -> Iterator[LookCase]:
    """Yield a case with each face alone."""
    bright, count = case.moving[0].reflectance, len(case.moving)
    for k in range(count):
        light = [bright if k == other else case.background for other in range(count)]
        pairs = zip(case.moving, light, strict=True)
        faces = tuple(replace(layer, reflectance=each) for layer, each in pairs)
        yield replace(case, moving=faces)


def blurred_faces(case: LookCase) -> tuple[bool, ...]:
    """Return which faces, (F,), show hardly anywhere as bright as they are.

    As much as a point of it fills in the image must be far enough from edges.
    """
    bright, around = case.moving[0].reflectance, case.background
    images = face_images(case) / case.light.gain
    images[0] -= around
    share = images / (bright - around)
    scope = case.microscope
    least_px = math.pi * (scope.airy_radius_um * scope.px_per_um) ** 2
    return tuple(bool((each >= _WHOLE).sum() < least_px) for each in share)
