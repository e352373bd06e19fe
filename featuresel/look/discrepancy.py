"""What no model of an image has: real edges, faces and pixels differ from it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contour.polarity import place
from microplan.featuresel.routines.contract import Target

_NODES = 2.0  # of a smooth field, so many for each correlation length
_BEYOND = 2.5  # correlation lengths: what lies farther off has no weight
_WHITE_PX = 0.4  # of such a length pixels have less than .05 in common
_DARK = 1e-9  # of full scale: a step that is none


@dataclass(frozen=True, slots=True, kw_only=True)
class Discrepancy:
    """How far pictures differ from modelled ones, as standard deviations.

    One draw stays with a look's pictures at one height and zoom: no average of frames
    makes it smaller.
    """

    edge: float  # in the middle of an edge, share of the step between its two faces
    flat: float  # smooth, share of the local light
    pixel: float  # of each pixel, share of full scale
    fine_um: float  # least correlation length along edges: wavelength over aperture
    size_um: float  # the largest, and that of faces: the target's size

    def __post_init__(self) -> None:
        for name in ("edge", "flat", "pixel"):
            value = getattr(self, name)
            if not (value >= 0 and math.isfinite(value)):
                raise ValueError(f"{name} must be finite and >= 0, got {value}")
        if not 0 < self.fine_um <= self.size_um < math.inf:
            raise ValueError(
                f"lengths must be 0 < fine_um <= size_um, got {self.fine_um}, "
                f"{self.size_um}"
            )


def drawn(
    image: FloatArray,
    size: Discrepancy,
    um_per_px: float,
    reach_um: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Return one draw of what a picture shows besides a modelled one.

    Parameters
    ----------
    image : (rows, columns) float array
        Without noise, 1 at full scale.
    size : Discrepancy
        Its standard deviations.
    um_per_px : float
        In object space.
    reach_um : float
        How far a blurred edge of the target reaches to either side.
    rng : numpy.random.Generator
        Source of the draw.

    Returns
    -------
    (rows, columns) float64 array
        To be added, 1 at full scale.

    Notes
    -----
    Over a blurred edge coverage c goes from 0 to 1: 4 c (1 - c) is 1 in its middle and
    0 on both faces, whatever its blur, and c is where the light lies between the
    darkest and the brightest within `reach_um`.
    """
    ratio = math.log(size.size_um / size.fine_um)
    along_um = size.fine_um * math.exp(ratio * rng.random())
    edges = smooth_field(image.shape, along_um / um_per_px, rng)
    faces = smooth_field(image.shape, size.size_um / um_per_px, rng)
    pixels = rng.standard_normal(image.shape)
    found: FloatArray = size.edge * edges * edge_steps(image, reach_um / um_per_px)
    return found + size.flat * faces * image + size.pixel * pixels


def smooth_field(
    shape: tuple[int, ...], length_px: float, rng: np.random.Generator
) -> FloatArray:
    """Return a stationary normal field of mean 0 and variance 1, (rows, columns).

    Its covariance at the distance d is exp(-d^2 / (2 length_px^2)).
    """
    if length_px < _WHITE_PX:
        return rng.standard_normal(shape)
    down, across = (_weights(count, length_px) for count in shape)
    nodes = rng.standard_normal((down.shape[1], across.shape[1]))
    field: FloatArray = down @ nodes @ across.T
    return field


def _weights(count: int, length_px: float) -> FloatArray:
    """Return weights of nodes at pixels along an axis, (count, N), squares sum to 1."""
    step, beyond = length_px / _NODES, _BEYOND * length_px
    nodes = np.arange(-beyond, count - 1 + beyond + step, step)
    off = (np.arange(count)[:, None] - nodes) / length_px
    weights = np.exp(-(off**2))
    found: FloatArray = weights / np.sqrt((weights**2).sum(axis=1, keepdims=True))
    return found


def edge_steps(image: FloatArray, reach_px: float) -> FloatArray:
    """Return steps of edges in their middles, falling to 0 on faces, (rows, columns).

    Of an image (rows, columns) without noise; an edge reaches `reach_px` either side.
    """
    least, most = _around(image, reach_px)
    step = np.maximum(most - least, _DARK)
    found: FloatArray = 4 * (image - least) * (most - image) / step
    return found


def _around(image: FloatArray, reach_px: float) -> tuple[FloatArray, FloatArray]:
    """Return the least and the most light so near to each pixel."""
    side = 2 * max(1, round(min(reach_px, max(image.shape)))) + 1
    near = np.ones((side, side), np.uint8)
    least: FloatArray = np.asarray(cv2.erode(image, near), dtype=np.float64)
    most: FloatArray = np.asarray(cv2.dilate(image, near), dtype=np.float64)
    return least, most


def contrast(image: FloatArray, target: Target, reach_px: float) -> float:
    """Return the usual step of light at a target's edges, 1 at full scale.

    Parameters
    ----------
    image : (rows, columns) float array
        With the target at its nominal pose, without noise.
    target : Target
        With the points of its edges; without any in view the whole range counts.
    reach_px : float
        How far a blurred edge reaches to either side.
    """
    points = np.array(target.contour, dtype=np.float64).reshape(-1, 4)
    column, row, *_ = place(points, target).T
    at = np.rint(np.stack((row, column))).astype(np.intp)
    seen = np.all((at >= 0) & (at < np.array(image.shape)[:, None]), axis=0)
    if not seen.any():
        return float(np.ptp(image))
    least, most = _around(image, reach_px)
    return float(np.median((most - least)[tuple(at[:, seen])]))
