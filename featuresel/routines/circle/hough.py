"""OpenCV's Hough circle: votes for the centre in whole pixels. Kept as a control."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Routine,
    Target,
)

_FAINT = 0.1  # span of values below which there is no edge to vote
_RADIUS_OFF = 0.1  # of the radius, at least 1 px
_CANNY_SHARE = 0.5  # of the predicted gradient, the threshold of an edge
_SMOOTH_PX = 1.0  # before the gradient: a single noisy pixel is no edge
_FIXED_WORK, _PIXEL_WORK = 0.1, 1.3e-5  # in box filters
_SPREAD_PX = 0.5  # votes are counted in pixels


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return the radius and the gradient and votes of the nominal rim."""
    p, k = target.parameters, target.px_per_um
    named = [p[name] for name in ("radius_um", "bore_um", "root_um") if name in p]
    radius = named[0] * k
    if radius < 3:
        return Failure("too_small", f"radius of {radius:.2f} px, at least 3")
    image = render()
    column, row = round(target.column), round(target.row)
    reach = int(radius) + 3
    near = image[
        max(row - reach, 0) : row + reach, max(column - reach, 0) : column + reach
    ]
    if near.size == 0 or float(np.ptp(near)) < _FAINT:
        return Failure("no_contrast", "no edge is predicted")
    span = float(np.ptp(image))
    grey = _grey(image, span)
    across = cv2.Sobel(grey, cv2.CV_32F, 1, 0)
    down = cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    rim = _rim(image.shape, target, radius)
    if not rim.any():
        return Failure("outside", "the rim is out of view")
    gradient = float(np.median((np.abs(across) + np.abs(down))[rim]))
    return Artifact(
        parameters={
            "radius_px": radius,
            "span": span,
            "canny": max(_CANNY_SHARE * gradient, 1.0),
            "votes": max(0.3 * math.tau * radius / 2, 5.0),
            "search_px": target.search_px,
        }
    )


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the circle with the most votes, px, in `image`, (rows, columns) 0..1."""
    p = artifact.parameters
    span = float(np.ptp(image))
    if span < _FAINT:
        return Failure("no_contrast", f"values span {span:.3f}")
    band = max(1.0, _RADIUS_OFF * p["radius_px"])
    circles = cv2.HoughCircles(
        _grey(image, span),
        cv2.HOUGH_GRADIENT,
        dp=1,
        minDist=max(p["radius_px"] / 2, 1.0),
        param1=p["canny"],
        param2=p["votes"],
        minRadius=max(1, math.floor(p["radius_px"] - band)),
        maxRadius=math.ceil(p["radius_px"] + band),
    )
    if circles is None:
        return Failure("no_edge", "no circle has enough votes")
    # the strongest comes first
    for column, row, _ in np.asarray(circles, dtype=np.float64).reshape(-1, 3):
        away = math.hypot(column - guess.column, row - guess.row)
        if away <= 1.5 * p["search_px"] + 2:
            return Measurement(
                column=float(column),
                row=float(row),
                score=0.5,  # the votes are not reported
                spread_px=_SPREAD_PX,
            )
    return Failure("outside", "no circle is within the search")


def cost(_artifact: Artifact, pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    return _FIXED_WORK + _PIXEL_WORK * pixels


HOUGH = Routine(
    name="hough",
    version="1",
    kinds=("circle", "teeth"),
    principle="edges",
    provides=("xy",),
    baseline=True,
    prepare=prepare,
    measure=measure,
    cost=cost,
)


def _grey(image: FloatArray, span: float) -> npt.NDArray[np.uint8]:
    """Return the image stretched to 8 bits and smoothed; OpenCV takes nothing else."""
    grey = np.rint((image - image.min()) * (255 / span)).astype(np.uint8)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), _SMOOTH_PX), dtype=np.uint8)


def _rim(
    shape: tuple[int, ...], target: Target, radius_px: float
) -> npt.NDArray[np.bool_]:
    """Return the pixels that the rim crosses, (rows, columns)."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    distance = np.hypot(columns - target.column, rows - target.row)
    return np.asarray(np.abs(distance - radius_px) <= 0.7)
