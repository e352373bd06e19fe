"""Animals that misjudge an angle."""

from __future__ import annotations

import math

import cv2
import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Target,
)
from microplan.featuresel.routines.sampling import cubic
from tests.featuresel.zoo.zoo_kinds import animal, answer


def _drawn_teeth(render: LookModel, target: Target) -> Artifact | Failure:
    """Return the drawn teeth: their number, radius and phase, and no image."""
    p = target.parameters
    return Artifact(
        parameters={
            "count": p["count"],
            "radius_px": (p["root_um"] + p["outer_um"]) / 2 * target.px_per_um,
            "phase_rad": p["phase_rad"],
            "theta_rad": target.theta_rad,
        }
    )


def _nearest_tooth(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Take the phase of bright teeth, and of all of them the one nearest the guess.

    Teeth beyond the focus at which their contrast reverses are dark, and of a part at
    any angle the nearest tooth is one of many.
    """
    p = artifact.parameters
    angles = np.linspace(0, math.tau, 40 * int(p["count"]), endpoint=False)
    values, _ = cubic(
        image,
        guess.column + p["radius_px"] * np.cos(angles),
        guess.row - p["radius_px"] * np.sin(angles),
    )
    wave = complex((values * np.exp(1j * p["count"] * angles)).sum())
    phase = math.atan2(wave.imag, wave.real) / p["count"] - p["phase_rad"]
    near = p["theta_rad"] if guess.theta_rad is None else guess.theta_rad
    theta = near + math.remainder(phase - near, math.tau / p["count"])
    return answer(guess.column, guess.row, math.remainder(theta, math.tau))


def _grey(image: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return np.rint(image * 255).astype(np.uint8)


def _keypoints(render: LookModel, target: Target) -> Artifact | Failure:
    """Return SIFT keypoints of the nominal image."""
    found, described = cv2.SIFT_create().detectAndCompute(_grey(render()), None)  # type: ignore[attr-defined] # OpenCV's stubs lack it
    return Artifact(
        parameters={
            "column": target.column,
            "row": target.row,
            "theta_rad": target.theta_rad,
        },
        arrays={
            "points": np.array([k.pt for k in found], dtype=np.float32),
            "described": np.asarray(described, dtype=np.float32),
        },
    )


def _homography(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Fit eight numbers to keypoints that every tooth has alike, and ask no more."""
    p = artifact.parameters
    found, described = cv2.SIFT_create().detectAndCompute(_grey(image), None)  # type: ignore[attr-defined] # OpenCV's stubs lack it
    if described is None or len(found) < 4:
        return Failure(code="few_points", message=f"{len(found)} keypoints")
    pairs = cv2.BFMatcher().match(artifact.arrays["described"], described)
    source = np.array([artifact.arrays["points"][m.queryIdx] for m in pairs])
    seen = np.array([found[m.trainIdx].pt for m in pairs], dtype=np.float32)
    if len(pairs) < 4:
        return Failure(code="few_points", message=f"{len(pairs)} matches")
    motion, _ = cv2.findHomography(source, seen, cv2.RANSAC, 3.0)
    if np.ndim(motion) != 2:  # OpenCV has none to give
        return Failure(code="no_motion", message="no homography")
    ends = np.array([(p["column"], p["row"], 1.0), (p["column"] + 1, p["row"], 1.0)])
    (x, y), (xx, yy) = (q[:2] / q[2] for q in (ends @ np.asarray(motion).T))
    theta = p["theta_rad"] + math.atan2(-(yy - y), xx - x)
    return answer(x, y, math.remainder(theta, math.tau))


NEAREST_TOOTH = animal(
    name="nearest_tooth",
    kind="teeth",
    prepare=_drawn_teeth,
    measure=_nearest_tooth,
    provides=("theta",),
    requires=("xy",),
    capture_px=2.0,
)
HOMOGRAPHY = animal(
    name="homography",
    kind="teeth",
    prepare=_keypoints,
    measure=_homography,
    provides=("xy", "theta"),
)
