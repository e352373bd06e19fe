"""Straight calipers across one edge, two parallel edges, or the two legs of a corner.

Of one edge the position across it and its angle are measured. Of two parallel edges it
is the middle between them, which everything that moves both apart leaves alone: blur,
zoom and the width as fabricated. Of a corner it is the point where lines through both
legs meet, fitted away from the tip, which blur rounds.
"""

from __future__ import annotations

import math
from dataclasses import replace

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
from microplan.featuresel.routines.edge.faces import JawFace
from microplan.featuresel.routines.edge.straight import (
    faces_work,
    measure_faces,
    prepare_faces,
)

_OFF_ENDS_PX = 2.0  # of the search, at both ends: corners are rounded by blur
_MOST_OFF = 0.25  # of the length
_WIDTH_PX, _WIDTH_PART = 2.0, 0.06  # accepted error of the width
_OFF_PX, _OFF = 3.0, 0.2  # from the corner: px at least, and of the reach
_LEAST_RAD = 0.2  # inside angle from which, and up to pi less, two lines meet well


def prepare_edge(render: LookModel, target: Target) -> Artifact | Failure:
    """Return the edge's polarity, step, filter width and calibrated position."""
    return prepare_faces(render, target, {"edge": _across(target, 1.0, 0.0)})


def measure_edge(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the edge's position, px, and angle in `image`, (rows, columns) 0..1.

    Along the edge the position is that of the guess.
    """
    found = measure_faces(image, artifact, guess)
    return found if isinstance(found, Failure) else found.across()


def prepare_pair(render: LookModel, target: Target) -> Artifact | Failure:
    """Return both edges' polarity, step, filter width and calibrated position."""
    wide = target.parameters["width_um"] * target.px_per_um
    faces = {
        "right": _across(target, 1.0, wide / 2),
        "left": _across(target, -1.0, wide / 2),
    }
    artifact = prepare_faces(render, target, faces, breathes=True)
    if isinstance(artifact, Failure):
        return artifact
    return Artifact(parameters={**artifact.parameters, "width_px": wide})


def measure_pair(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the pair's middle, px, and angle in `image`, (rows, columns) 0..1.

    Along the edges the position is that of the guess.
    """
    found = measure_faces(image, artifact, guess)
    if isinstance(found, Failure):
        return found
    wide = artifact.parameters["width_px"]
    if abs(2 * found.grown_px) > max(_WIDTH_PX, _WIDTH_PART * wide):
        return Failure(
            "width_off", f"width off by {2 * found.grown_px:.2f} of {wide:.2f} px"
        )
    return found.across()


def prepare_corner(render: LookModel, target: Target) -> Artifact | Failure:
    """Return both legs' polarity, step, filter width and calibrated position."""
    angle, reach = target.parameters["angle_rad"], target.parameters["reach_um"]
    if abs(math.sin(angle)) < math.sin(_LEAST_RAD):
        return Failure("flat", f"legs at {angle:.3f} rad meet nowhere for certain")
    far = reach * target.px_per_um
    near = max(_OFF_PX, _OFF * far)
    legs = {
        "upper": _leg(math.pi - angle / 2, near, far),
        "lower": _leg(math.pi + angle / 2, near, far),
    }
    return prepare_faces(render, target, legs)


def measure_corner(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return where the legs meet, px, in `image`, (rows, columns) 0..1.

    The angle is that of the bisector out of the part.
    """
    found = measure_faces(image, artifact, guess)
    return found if isinstance(found, Failure) else found.at_point()


LINE_CALIPER = Routine(
    name="line_caliper",
    version="1",
    kinds=("edge",),
    principle="edges",
    provides=("xy", "theta"),
    prepare=prepare_edge,
    measure=measure_edge,
    cost=faces_work,
)

EDGE_PAIR = replace(
    LINE_CALIPER,
    name="edge_pair",
    kinds=("pair",),
    prepare=prepare_pair,
    measure=measure_pair,
)

CORNER = replace(
    LINE_CALIPER,
    name="corner",
    kinds=("corner",),
    prepare=prepare_corner,
    measure=measure_corner,
)


def _across(target: Target, normal: float, offset_px: float) -> JawFace:
    """Return the part of an edge that the search does not move over its ends."""
    long = target.parameters["length_um"] * target.px_per_um
    half = long / 2 - min(target.search_px + _OFF_ENDS_PX, _MOST_OFF * long)
    return JawFace(
        normal=(normal, 0.0), offset_px=offset_px, low_px=-half, high_px=half
    )


def _leg(along_rad: float, near_px: float, far_px: float) -> JawFace:
    """Return the leg off the corner in a direction; its normal is to its right."""
    return JawFace(
        normal=(math.sin(along_rad), -math.cos(along_rad)),
        offset_px=0.0,
        low_px=near_px,
        high_px=far_px,
    )
