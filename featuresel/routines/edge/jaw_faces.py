"""The faces of a pair of jaws: where they should be, and how they look there."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import Target
from microplan.featuresel.routines.edge.faces import (
    FAINT,
    LINES_PX,
    JawFace,
    measure_face,
    points,
)
from microplan.featuresel.routines.sampling import STEP_PX, best_width, cubic

# Faces: across the fingers' sides (normal along x) and the tips (normal along -y).
SIDES = ("inner_left", "inner_right", "outer_left", "outer_right")
TIPS = ("tip_left", "tip_right")


def predicted(target: Target) -> dict[str, JawFace]:
    """Return the predicted faces; fingers reach up without end."""
    k, p = target.px_per_um, target.parameters
    half, wide = p["opening_um"] / 2 * k, p["finger_width_um"] * k
    tip = -p["grip_from_tip_um"] * k
    low, high = tip + 0.15 * wide, tip + 3 * wide  # off the tip's corner
    right, left, down = (1.0, 0.0), (-1.0, 0.0), (0.0, -1.0)
    inside, outside = half + 0.15 * wide, half + 0.8 * wide
    # for the normal n the stretch runs along n turned by +90 degrees: up for `right`,
    # down for `left`, right for `down`
    return {
        "inner_left": JawFace(normal=right, offset_px=-half, low_px=low, high_px=high),
        "inner_right": JawFace(
            normal=left, offset_px=-half, low_px=-high, high_px=-low
        ),
        "outer_left": JawFace(
            normal=left, offset_px=half + wide, low_px=-high, high_px=-low
        ),
        "outer_right": JawFace(
            normal=right, offset_px=half + wide, low_px=low, high_px=high
        ),
        "tip_left": JawFace(
            normal=down, offset_px=-tip, low_px=-outside, high_px=-inside
        ),
        "tip_right": JawFace(
            normal=down, offset_px=-tip, low_px=inside, high_px=outside
        ),
    }


def in_view(
    face: JawFace,
    shape: tuple[int, ...],
    at: tuple[float, float, float],
    search_px: float,
) -> JawFace | None:
    """Return the face cut to what stays in the image anywhere in the search."""
    room = search_px + 3.0
    along = np.arange(face.low_px, face.high_px, LINES_PX)
    columns, rows = points(face, at, along, np.zeros(1))
    inside = (columns > room) & (columns < shape[1] - 1 - room)
    inside &= (rows > room) & (rows < shape[0] - 1 - room)
    kept = along[inside[:, 0]]
    if len(kept) < 8:
        return None
    return JawFace(
        normal=face.normal,
        offset_px=face.offset_px,
        low_px=float(kept[0]),
        high_px=float(kept[-1]),
    )


def calibrate(
    image: FloatArray, face: JawFace, at: tuple[float, float, float]
) -> Mapping[str, float] | None:
    """Return the face's numbers, its place and slope as measured; None if too faint."""
    along = np.arange(face.low_px, face.high_px, LINES_PX)
    span = np.arange(-24, 25, dtype=np.float64) * STEP_PX
    profile = np.median(cubic(image, *points(face, at, along, span))[0], axis=0)
    width = best_width(profile)
    gap = min(int(1.5 * width / STEP_PX) + 1, 24)
    step = float(profile[24 - gap] - profile[24 + gap])  # bright inside, normal out
    if step < FAINT:
        return None
    numbers = {
        "normal_x": face.normal[0],
        "normal_y": face.normal[1],
        "low_px": face.low_px,
        "high_px": face.high_px,
        "width_px": width,
        "step": step,
        "offset_px": face.offset_px,
        "slope": 0.0,
    }
    found = measure_face(image, numbers, at, 4.0)
    if found is None:
        return None
    return {**numbers, "offset_px": found.offset_px, "slope": found.slope}
