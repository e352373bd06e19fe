"""Straight calipers across the jaws: their sides give x and angle, their tips y."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines import work
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Routine,
    Target,
)
from microplan.featuresel.routines.edge.faces import (
    LINES_PX,
    SIDES,
    TIPS,
    TURN_STEP_RAD,
    MeasuredFace,
    calibrate,
    face_numbers,
    in_view,
    measure_face,
    off_search,
    predicted,
    rough_turn,
)
from microplan.featuresel.routines.sampling import edge_kernel, line_samples

_SPARSE = 4  # lines are skipped for the rough turn
_NEAR_PX = 4.0  # what the first fit leaves to search
_LINE_WORK = 0.4  # of the line through a face's edges, in box filters
_LOCKED_PX = 0.02  # edges along pixel rows share one sampling error; lines do not help
_MOST_TURN_RAD = 0.3  # beyond, the stretches no longer lie on their faces
_ZOOM = 0.02  # zoom error allowed for: far faces move by this part of their distance
_FINE_PX = 4.0  # half the last search
# Of that: edges found anywhere in it, as in noise, scatter by 1 / sqrt(3).
_SCATTERED = 0.5 / math.sqrt(3)
_OPENING_PX, _OPENING_PART = 2.0, 0.04  # accepted error of the opening


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return the faces in view, each with step, filter width and calibrated position.

    The inner faces and one tip are needed; the outer faces help where they are in view.
    """
    image, at = render(), (target.column, target.row, target.theta_rad)
    parameters = {
        "search_px": target.search_px,
        "theta_rad": target.theta_rad,
        "range_rad": min(target.theta_range_rad, _MOST_TURN_RAD),
        "opening_px": target.parameters["opening_um"] * target.px_per_um,
    }
    for name, whole in predicted(target).items():
        face = in_view(whole, image.shape, at, target.search_px)
        numbers = None if face is None else calibrate(image, face, at)
        if numbers is not None:
            parameters |= {f"{name}.{key}": value for key, value in numbers.items()}
    missing = [name for name in SIDES[:2] if f"{name}.step" not in parameters]
    if not any(f"{name}.step" in parameters for name in TIPS):
        missing.append("tips")
    if missing:
        return Failure("no_edge", f"not to be seen: {', '.join(missing)}")
    return Artifact(parameters=parameters)


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the grip's position, px, and angle in `image`, (rows, columns) 0..1.

    Fails if a face is missing or misplaced.
    """
    p = artifact.parameters
    column, row = guess.column, guess.row
    inner_faces = [face_numbers(p)[name] for name in SIDES[:2]]
    theta = p["theta_rad"] + rough_turn(
        image, inner_faces, p, guess, sparse=lambda _: _SPARSE
    )
    found: dict[str, MeasuredFace] = {}
    for half in (p["search_px"], _NEAR_PX, _NEAR_PX):
        faces = _find(image, p, (column, row, theta), half)
        if isinstance(faces, Failure):
            return faces
        found = faces
        dx, dy, turn = _pose(found, p)
        c, s = math.cos(theta), math.sin(theta)
        column, row = column + c * dx - s * dy, row - s * dx - c * dy
        theta += turn
    worst = max(face.rms_px for face in found.values())
    if worst > _SCATTERED * _FINE_PX:
        return Failure(
            "scattered",
            f"edges lie {worst:.2f} px about a face, "
            f"at most {_SCATTERED * _FINE_PX:.2f}",
        )
    problem = _misplaced(found, p, guess, (column, row, theta))
    if problem is not None:
        return problem
    inner = [found[name] for name in SIDES[:2]]
    spread = math.sqrt(sum(f.rms_px**2 / f.lines for f in inner)) / 2
    tips = [found[name] for name in TIPS if name in found]
    tip_spread = math.sqrt(sum(f.rms_px**2 / f.lines for f in tips)) / len(tips)
    return Measurement(
        column=column,
        row=row,
        theta_rad=math.remainder(theta, 2 * math.pi),
        score=len(found) / len(face_numbers(p)),
        spread_px=math.hypot(max(spread, tip_spread), _LOCKED_PX),
    )


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    p = artifact.parameters
    rough = 2 * math.ceil(p["range_rad"] / TURN_STEP_RAD) + 1
    total = 0.0
    for name, face in face_numbers(p).items():
        width, zoomed = face["width_px"], _ZOOM * abs(face["offset_px"])
        lines = (face["high_px"] - face["low_px"]) / LINES_PX
        total += _face_work(lines, p["search_px"] + zoomed, width)
        total += 2 * _face_work(lines, _NEAR_PX + zoomed, width)
        if name in SIDES[:2]:
            total += rough * _face_work(lines / _SPARSE, p["search_px"], width)
    return total


EDGE_CALIPER = Routine(
    name="edge_caliper",
    version="2",
    kinds=("jaws",),
    principle="edges",
    provides=("xy", "theta"),
    prepare=prepare,
    measure=measure,
    cost=cost,
)


def _face_work(lines: float, half_px: float, width_px: float) -> float:
    """Return the work of measuring one face."""
    length, kernel = len(line_samples(half_px, width_px)), len(edge_kernel(width_px))
    return work.edges(lines, length, kernel) + _LINE_WORK


def _find(
    image: FloatArray,
    p: Mapping[str, float],
    at: tuple[float, float, float],
    half_px: float,
) -> dict[str, MeasuredFace] | Failure:
    """Return the faces that were found; the inner ones and a tip must be among them."""
    found = {}
    for name, numbers in face_numbers(p).items():
        half = half_px + _ZOOM * abs(numbers["offset_px"])
        face = measure_face(image, numbers, at, half)
        if face is not None:
            found[name] = face
    missing = [name for name in SIDES[:2] if name not in found]
    if not any(name in found for name in TIPS):
        missing.append("tips")
    whole = [_pair(side) for side in ("left", "right")]
    known = [pair for pair in whole if all(f"{name}.step" in p for name in pair)]
    if known and not any(set(pair) <= set(found) for pair in known):
        missing.append("a finger's both sides")
    if missing:
        return Failure("no_edge", f"not found: {', '.join(missing)}")
    return found


def _pair(side: str) -> tuple[str, str]:
    """Return the names of a finger's inner and outer face."""
    return (f"inner_{side}", f"outer_{side}")


def _pose(
    found: Mapping[str, MeasuredFace], p: Mapping[str, float]
) -> tuple[float, float, float]:
    """Return (x, y, rotation) of the grip against where it was sought, its own frame.

    A rotation by t changes each face's slope by t; a shift moves its offset by the
    shift's part along the normal, and the rotation moves the stretch's middle by t
    times its lever. Lines weigh by their number; the pairs of faces keep x free of the
    opening.
    """
    sides = [name for name in SIDES if name in found]
    turn = float(
        np.average(
            [found[n].slope - p[f"{n}.slope"] for n in sides],
            weights=[(found[n].lines) ** 3 for n in sides],
        )
    )
    shift = {
        n: found[n].offset_px - p[f"{n}.offset_px"] - turn * found[n].middle_px
        for n in found
    }
    pairs = [("inner_left", "inner_right"), ("outer_right", "outer_left")]
    xs = [(shift[a] - shift[b]) / 2 for a, b in pairs if a in shift and b in shift]
    # at another zoom the tips are farther from the grip than predicted
    lever = _scale(found, p) - 1
    ys = [lever * p[f"{n}.offset_px"] - shift[n] for n in TIPS if n in shift]
    return float(np.mean(xs)), float(np.mean(ys)), -turn


def _scale(found: Mapping[str, MeasuredFace], p: Mapping[str, float]) -> float:
    """Return zoom over nominal by the widths of fingers seen whole, 1 if none is.

    The fingers' width is as fabricated; the opening is the gripper's and proves
    nothing.
    """
    ratios = []
    for side in ("left", "right"):
        inner, outer = _pair(side)
        if inner in found and outer in found:
            wide = found[inner].offset_px + found[outer].offset_px
            nominal = p[f"{inner}.offset_px"] + p[f"{outer}.offset_px"]
            ratios.append(wide / nominal)
    return float(np.mean(ratios)) if ratios else 1.0


def _misplaced(
    found: Mapping[str, MeasuredFace],
    p: Mapping[str, float],
    guess: Guess,
    pose: tuple[float, float, float],
) -> Failure | None:
    """Return why the faces cannot be the jaws' as predicted, if they cannot."""
    gap = -found["inner_left"].offset_px - found["inner_right"].offset_px
    wanted = -p["inner_left.offset_px"] - p["inner_right.offset_px"]
    if abs(gap - wanted) > max(_OPENING_PX, _OPENING_PART * p["opening_px"]):
        return Failure("opening_off", f"opening {gap:.2f} px, predicted {wanted:.2f}")
    return off_search(pose, p, guess)
