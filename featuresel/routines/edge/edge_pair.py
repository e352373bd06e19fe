"""Straight calipers across two parallel edges: the middle between them, and the angle.

What moves both edges apart, as blur, zoom and the width as made do, leaves the middle.
"""

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

NAME = "edge_pair"
VERSION = "1"
KINDS: tuple[TargetKind, ...] = ("pair",)
PROVIDES: tuple[PoseTerm, ...] = ("xy", "theta")
REQUIRES: tuple[PoseTerm, ...] = ()
CAPTURE_PX = math.inf
BASELINE = False
EXPENSIVE = False

_OFF_ENDS_PX = 2.0  # of the search, at both ends: corners are rounded by blur
_MOST_OFF = 0.25  # of the length
_WIDTH_PX, _WIDTH_PART = 2.0, 0.06  # accepted error of the width


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return both edges' polarity, step, filter width and calibrated place."""
    p, k = target.parameters, target.px_per_um
    long, wide = p["length_um"] * k, p["width_um"] * k
    half = long / 2 - min(target.search_px + _OFF_ENDS_PX, _MOST_OFF * long)
    faces = {
        "right": JawFace(
            normal=(1.0, 0.0), offset_px=wide / 2, low_px=-half, high_px=half
        ),
        "left": JawFace(
            normal=(-1.0, 0.0), offset_px=wide / 2, low_px=-half, high_px=half
        ),
    }
    artifact = prepare_faces(render, target, faces, breathes=True)
    if isinstance(artifact, Failure):
        return artifact
    return Artifact(parameters={**artifact.parameters, "width_px": wide})


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the middle across, along the edges that of the guess, and the angle."""
    found = measure_faces(image, artifact, guess)
    if isinstance(found, Failure):
        return found
    wide = artifact.parameters["width_px"]
    if abs(2 * found.grown_px) > max(_WIDTH_PX, _WIDTH_PART * wide):
        return Failure(
            code="width_off",
            message=f"width off by {2 * found.grown_px:.2f} of {wide:.2f} px",
        )
    return found.across()


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    return faces_work(artifact)
