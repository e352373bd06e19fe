"""AKAZE keypoints matched with those of the nominal image. Kept as a control.

Machined edges are alike everywhere, so descriptors of them are too; the corners that
differ are few, and found to a good part of a pixel at best.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

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
from microplan.featuresel.routines.picture import half_px

_FAINT = 0.05  # span of values below which there is nothing to describe
_THRESHOLD = 5e-4  # of the detector; its default finds next to nothing on smooth edges
_RATIO = 0.8  # of the best match's distance to the second's, at most: Lowe's
_FEWEST = 4  # matches that agree on one motion
_WITHIN_PX = 2.0  # of that motion
_PIXEL_WORK = 2.2e-4  # of detection, in box filters
_SCALE_OFF = 0.05  # zoom errors stay below 2 %

_Bytes = npt.NDArray[np.uint8]


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return keypoints and descriptors of the target on the nominal image."""
    image = render()
    half = half_px(target, image.shape, 0.0)
    if min(half) < 8:
        return Failure("outside", f"{min(half)} px between target and border")
    if float(np.ptp(image)) < _FAINT:
        return Failure("no_contrast", "the look is blank")
    points, descriptors = _describe(image)
    away = points - np.array((target.column, target.row))
    own = (np.abs(away) <= np.array(half)).all(axis=1)
    if own.sum() < _FEWEST:
        return Failure("few_points", f"{own.sum()} keypoints, at least {_FEWEST}")
    return Artifact(
        parameters={
            "theta_rad": target.theta_rad,
            "range_rad": target.theta_range_rad,
            "search_px": target.search_px,
        },
        arrays={
            "points": away[own].astype(np.float32),
            "descriptors": descriptors[own].astype(np.float32),  # bytes: kept exactly
        },
    )


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the motion, px, most matches agree on in `image`, (rows, columns) 0..1."""
    p = artifact.parameters
    if float(np.ptp(image)) < _FAINT or min(image.shape) < 16:
        return Failure("no_contrast", "the image is blank or tiny")
    points, descriptors = _describe(image)
    known = artifact.arrays["descriptors"].astype(np.uint8)
    pairs = _matches(known, descriptors)
    if len(pairs) < _FEWEST:
        return Failure("few_points", f"{len(pairs)} matches, at least {_FEWEST}")
    source = artifact.arrays["points"][pairs[:, 0]]
    motion, inliers = cv2.estimateAffinePartial2D(
        source,
        points[pairs[:, 1]].astype(np.float32),
        method=cv2.RANSAC,
        ransacReprojThreshold=_WITHIN_PX,
    )
    agreeing = np.asarray(inliers, dtype=np.uint8)
    if motion is None or agreeing.sum() < _FEWEST:
        return Failure("few_points", "no motion has matches enough")
    return _answer(np.asarray(motion, dtype=np.float64), agreeing, p, guess)


def cost(_artifact: Artifact, pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    return _PIXEL_WORK * pixels


KEYPOINTS = Routine(
    name="keypoints",
    version="1",
    kinds=("teeth", "outline", "jaws"),
    principle="area",
    provides=("xy", "theta"),
    baseline=True,
    prepare=prepare,
    measure=measure,
    cost=cost,
)


def _answer(
    motion: FloatArray, agreeing: _Bytes, p: Mapping[str, float], guess: Guess
) -> Measurement | Failure:
    """Return the pose that a similarity (2, 3) stands for."""
    scale = math.hypot(motion[0, 0], motion[1, 0])
    if abs(scale - 1) > _SCALE_OFF:
        return Failure("scale_off", f"{scale:.3f} times the template")
    turned = math.atan2(-motion[1, 0], motion[0, 0])
    column, row = float(motion[0, 2]), float(motion[1, 2])
    away = math.hypot(column - guess.column, row - guess.row)
    if away > 1.5 * p["search_px"] + 2:
        return Failure("outside", f"{away:.1f} px from the guess")
    if p["range_rad"] < 3 and abs(turned) > 1.2 * p["range_rad"] + 0.01:
        return Failure("outside", f"turned by {turned:.3f} rad")
    return Measurement(
        column=column,
        row=row,
        theta_rad=math.remainder(p["theta_rad"] + turned, math.tau),
        score=float(agreeing.mean()),
        spread_px=_WITHIN_PX / math.sqrt(float(agreeing.sum())),
    )


def _describe(image: FloatArray) -> tuple[FloatArray, _Bytes]:
    """Return keypoints (N, 2) as (column, row) and descriptors (N, D)."""
    low, span = float(image.min()), float(np.ptp(image))
    grey = np.rint((image - low) * (255 / span)).astype(np.uint8)
    detector = cv2.AKAZE_create(threshold=_THRESHOLD)  # type: ignore[attr-defined] # OpenCV's stubs lack it
    found, descriptors = detector.detectAndCompute(grey, None)
    if descriptors is None or not found:
        return np.zeros((0, 2)), np.zeros((0, 61), dtype=np.uint8)
    points = np.array([keypoint.pt for keypoint in found], dtype=np.float64)
    return points, np.asarray(descriptors, dtype=np.uint8)


def _matches(known: _Bytes, seen: _Bytes) -> npt.NDArray[np.intp]:
    """Return pairs (M, 2) of indices whose best match beats the second clearly."""
    if len(known) < 2 or len(seen) < 2:
        return np.zeros((0, 2), dtype=np.intp)
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    best = [
        (first.queryIdx, first.trainIdx)
        for first, second in matcher.knnMatch(known, seen, k=2)
        if first.distance < _RATIO * second.distance
    ]
    return np.array(best, dtype=np.intp).reshape(-1, 2)
