"""A straight caliper across one edge: its place across, and its angle."""

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

NAME = "line_caliper"
VERSION = "1"
KINDS: tuple[TargetKind, ...] = ("edge",)
PROVIDES: tuple[PoseTerm, ...] = ("xy", "theta")
REQUIRES: tuple[PoseTerm, ...] = ()
CAPTURE_PX = math.inf
BASELINE = False
EXPENSIVE = False

_OFF_ENDS_PX = 2.0  # of the search, at both ends: corners are rounded by blur
_MOST_OFF = 0.25  # of the length


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return the edge's polarity, step, filter width and calibrated place."""
    long = target.parameters["length_um"] * target.px_per_um
    # what is moved along the edge by the search must not lead over its end
    half = long / 2 - min(target.search_px + _OFF_ENDS_PX, _MOST_OFF * long)
    face = JawFace(normal=(1.0, 0.0), offset_px=0.0, low_px=-half, high_px=half)
    return prepare_faces(render, target, {"edge": face}, breathes=False)


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the place across the edge, along it that of the guess, and the angle."""
    found = measure_faces(image, artifact, guess)
    if isinstance(found, Failure):
        return found
    return found.across()


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    return faces_work(artifact)
