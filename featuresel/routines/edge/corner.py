"""Where two straight legs meet: lines fitted off the corner, which blur rounds."""

from __future__ import annotations

import math

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    PoseTerm,
    Target,
    TargetKind,
)
from microplan.featuresel.routines.edge.faces import JawFace
from microplan.featuresel.routines.edge.straight import (
    faces_work,
    measure_faces,
    prepare_faces,
)

NAME = "corner"
VERSION = "1"
KINDS: tuple[TargetKind, ...] = ("corner",)
PROVIDES: tuple[PoseTerm, ...] = ("xy", "theta")
REQUIRES: tuple[PoseTerm, ...] = ()
CAPTURE_PX = math.inf
BASELINE = False
EXPENSIVE = False

_OFF_PX, _OFF = 3.0, 0.2  # from the corner: px at least, and of the reach
_LEAST_RAD = 0.2  # inside angle from which, and up to pi less, two lines meet well


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return both legs' polarity, step, filter width and calibrated place."""
    angle, reach = target.parameters["angle_rad"], target.parameters["reach_um"]
    if abs(math.sin(angle)) < math.sin(_LEAST_RAD):
        return Failure(
            code="flat", message=f"legs at {angle:.3f} rad meet nowhere for certain"
        )
    far = reach * target.px_per_um
    near = max(_OFF_PX, _OFF * far)
    legs = {
        "upper": _leg(math.pi - angle / 2, near, far),
        "lower": _leg(math.pi + angle / 2, near, far),
    }
    return prepare_faces(render, target, legs, breathes=False)


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return where the legs meet, and the angle of the bisector out of the part."""
    found = measure_faces(image, artifact, guess)
    if isinstance(found, Failure):
        return found
    return found.at_point()


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    return faces_work(artifact)


def _leg(along_rad: float, near_px: float, far_px: float) -> JawFace:
    """Return the leg off the corner in a direction; its normal is to its right."""
    return JawFace(
        normal=(math.sin(along_rad), -math.cos(along_rad)),
        offset_px=0.0,
        low_px=near_px,
        high_px=far_px,
    )
