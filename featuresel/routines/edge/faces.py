"""Straight faces of known pose: lines across each, jaws among them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import Failure, Guess, Target
from microplan.featuresel.routines.sampling import (
    STEP_PX,
    best_width,
    cubic,
    find_edges,
    line_samples,
    median,
)

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
    """Return a face's numbers, px, in a (rows, columns) image; None if too faint."""
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


FAINT = 0.04  # step height below which an edge is not trusted
# Half of it moves a face's far end by 3 to 4 px: `measure_face` copes with twice of it.
TURN_STEP_RAD = math.radians(3)
_ALMOST = 0.9  # of the most lines: turns with as many are distinguished by slope
LINES_PX = 1.5  # between neighbouring lines: closer ones share their pixels
_WEAKEST = 0.3  # of the predicted step
_ROUNDS = 8  # of trimming
_FEWEST = 0.5  # of a face's lines must meet its edge, and of those half must fit


@dataclass(frozen=True, slots=True, kw_only=True)
class JawFace:
    """A straight edge in the grip's frame, px with y up: a normal and a stretch."""

    normal: tuple[float, float]  # points out of the finger
    offset_px: float  # of the face along the normal
    low_px: float  # ends of the stretch, along the normal turned by +90 degrees
    high_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredFace:
    """A face as measured: where, against the one predicted."""

    offset_px: float  # at the middle of the stretch, along the normal
    slope: float  # of the edge over the stretch
    middle_px: float
    rms_px: float
    lines: int


def measure_face(
    image: FloatArray,
    numbers: Mapping[str, float],
    at: tuple[float, float, float],
    half_px: float,
    *,
    sparse: int = 1,
) -> MeasuredFace | None:
    """Return the line, px, through a face's edges in an image, (rows, columns).

    Every `sparse`-th line is read; None if too few meet the edge.
    """
    face = JawFace(
        normal=(numbers["normal_x"], numbers["normal_y"]),
        offset_px=numbers["offset_px"],
        low_px=numbers["low_px"],
        high_px=numbers["high_px"],
    )
    along = np.arange(face.low_px, face.high_px, LINES_PX * sparse)
    offsets = line_samples(half_px, numbers["width_px"])
    columns, rows = points(face, at, along, offsets)
    edges = find_edges(image, columns, rows, width_px=numbers["width_px"], rising=False)
    good = edges.found & (edges.strength > max(_WEAKEST * numbers["step"], FAINT / 2))
    if good.sum() < max(5, _FEWEST * len(along)):
        return None
    middle = (face.low_px + face.high_px) / 2
    fitted = _line(along[good] - middle, edges.offset_px[good])
    if fitted is None:
        return None
    intercept, slope, rms, used = fitted
    return MeasuredFace(
        offset_px=face.offset_px + intercept,
        slope=slope,
        middle_px=middle,
        rms_px=rms,
        lines=used,
    )


def face_numbers(p: Mapping[str, float]) -> dict[str, Mapping[str, float]]:
    """Return the numbers of each face by its name, from an artifact's parameters."""
    faces: dict[str, dict[str, float]] = {}
    for key, value in p.items():
        name, dot, what = key.partition(".")
        if dot:
            faces.setdefault(name, {})[what] = value
    return dict(faces)


def rough_turn(
    image: FloatArray,
    faces: Sequence[Mapping[str, float]],
    p: Mapping[str, float],
    guess: Guess,
    *,
    sparse: Callable[[Mapping[str, float]], int],
) -> float:
    """Return the rotation from nominal, rad, by the start that meets faces squarest.

    In an image, (rows, columns) 0..1, every `sparse`-th line of a face is measured.
    """
    count = math.ceil(p["range_rad"] / TURN_STEP_RAD)
    tried: list[tuple[int, float, float]] = []  # lines, slope left, turn
    for k in range(-count, count + 1):
        turn = k * TURN_STEP_RAD
        at = (guess.column, guess.row, p["theta_rad"] + turn)
        found = [
            measure_face(image, f, at, p["search_px"], sparse=sparse(f)) for f in faces
        ]
        seen = [one for one in found if one is not None]
        if seen:
            slope = float(np.mean([one.slope for one in seen]))
            tried.append((sum(one.lines for one in seen), slope, turn - slope))
    if not tried:
        return 0.0
    most = max(lines for lines, _, _ in tried)
    return min((t for t in tried if t[0] >= _ALMOST * most), key=lambda t: abs(t[1]))[2]


def points(
    face: JawFace, at: tuple[float, float, float], along: FloatArray, out: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return (columns, rows), (N, L) px, of lines across the face, outwards."""
    column, row, theta = at
    nx, ny = face.normal
    normal = face.offset_px + out
    x = nx * normal - ny * along[:, None]
    y = ny * normal + nx * along[:, None]
    c, s = math.cos(theta), math.sin(theta)
    return column + c * x - s * y, row - s * x - c * y


def _line(x: FloatArray, y: FloatArray) -> tuple[float, float, float, int] | None:
    """Return (intercept, slope, rms, used) of a trimmed line; None if half strays."""
    # a turn of .09 rad spreads true points this far about their median
    used = np.abs(y - median(y)) <= max(3.0, 0.09 * float(np.ptp(x)))
    for _ in range(_ROUNDS):
        if used.sum() < max(5, _FEWEST * len(x)):
            return None
        intercept, slope = _least_squares(x[used], y[used])
        residual = y - intercept - slope * x
        robust = 1.4826 * median(np.abs(residual[used]))
        before, used = used, np.abs(residual) <= max(3 * robust, 0.1)
        if np.array_equal(used, before):  # so would be every round from here
            break
    rms = float(np.sqrt(np.mean(residual[used] ** 2)))
    return intercept, slope, rms, int(used.sum())


def _least_squares(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return (intercept, slope) of the line through points (N,), N >= 2."""
    mean_x, mean_y = float(x.mean()), float(y.mean())
    away = x - mean_x
    slope = float(away @ (y - mean_y)) / float(away @ away)
    return mean_y - slope * mean_x, slope


def off_search(
    at: tuple[float, float, float], p: Mapping[str, float], guess: Guess
) -> Failure | None:
    """Return why a pose (column, row, rad) is not where it was sought, if it is not."""
    away = math.hypot(at[0] - guess.column, at[1] - guess.row)
    if away > 1.5 * p["search_px"] + 2:
        return Failure("outside", f"{away:.1f} px from the guess")
    turned = abs(math.remainder(at[2] - p["theta_rad"], 2 * math.pi))
    if turned > p["range_rad"] * 1.2 + 0.01:
        return Failure("outside", f"turned by {turned:.3f} rad")
    return None
