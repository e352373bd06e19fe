"""Pose of straight edges of known position, by least squares over their lines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines import work
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Target,
)
from microplan.featuresel.routines.edge.faces import (
    LINES_PX,
    TURN_STEP_RAD,
    JawFace,
    MeasuredFace,
    calibrate,
    face_numbers,
    in_view,
    measure_face,
    off_search,
    rough_turn,
)
from microplan.featuresel.routines.sampling import edge_kernel, line_samples

MOST_TURN_RAD = 0.5  # beyond, the stretches no longer lie on their edges
_ROUGH = 10  # lines an edge when the turn is looked for
_HALF_PX = 4.0  # search once the edges are found
_TRIED = 0.7  # of the search: from so far the nominal edges must be found
_SAME_PX = 0.5  # two measurements of one edge differ by less
_BENT_PX = 0.6  # rms about a straight line, beyond the one predicted
_LINE = 2.0  # work of the line through an edge, in calls


def prepare_faces(
    render: LookModel,
    target: Target,
    faces: Mapping[str, JawFace],
    *,
    breathes: bool = False,
) -> Artifact | Failure:
    """Return the edges' numbers as seen on the nominal image.

    Parameters
    ----------
    render : LookModel
        The look.
    target : Target
        The target.
    faces : mapping of str to JawFace
        The edges in the target's frame, px; their normals may point either way.
    breathes : bool
        Whether all edges may be farther out than predicted, by one number: that of a
        pair says nothing about its middle.

    Returns
    -------
    Artifact or Failure
        "range" if any rotation is possible, "no_edge" if an edge is out of view or
        faint, "ambiguous" if another one like it lies within the search.
    """
    if target.theta_range_rad > MOST_TURN_RAD:
        return Failure(
            "range",
            f"turns of {target.theta_range_rad:.2f} rad, at most {MOST_TURN_RAD}",
        )
    image, at = render(), (target.column, target.row, target.theta_rad)
    parameters = {
        "search_px": target.search_px,
        "theta_rad": target.theta_rad,
        "range_rad": target.theta_range_rad,
        "breathes": float(breathes),
    }
    for name, whole in faces.items():
        numbers = _seen(image, whole, at, target.search_px)
        if numbers is None:
            return Failure("no_edge", f"not to be seen: {name}")
        parameters |= {f"{name}.{key}": value for key, value in numbers.items()}
    artifact = Artifact(parameters=parameters)
    return _rivalled(image, artifact, target) or artifact


def measure_faces(image: FloatArray, artifact: Artifact, guess: Guess) -> Fix | Failure:
    """Return the edges' pose, px, in `image`, (rows, columns) 0..1.

    Fails if an edge is missing, bent or out of range.
    """
    p = artifact.parameters
    if min(image.shape) < 4:
        return Failure("outside", f"an image of {image.shape} px")
    faces = face_numbers(p)
    theta = p["theta_rad"] + rough_turn(
        image, list(faces.values()), p, guess, sparse=_sparse
    )
    at = (guess.column, guess.row, theta)
    for half_px in (p["search_px"], _HALF_PX, _HALF_PX):
        found = {n: measure_face(image, f, at, half_px) for n, f in faces.items()}
        seen = {name: one for name, one in found.items() if one is not None}
        missing = [name for name in faces if name not in seen]
        if missing:
            return Failure("no_edge", f"not found: {', '.join(missing)}")
        change, covariance = solve(seen, faces, breathes=p["breathes"] > 0)
        at = moved(at, change)
    return _misplaced(seen, faces, p, guess, at) or fix(
        at, float(change[3]), covariance, seen, faces
    )


def faces_work(artifact: Artifact, _pixels: int) -> float:
    """Return the work of `measure_faces`, see `contract.Routine`."""
    p = artifact.parameters
    turns = 2 * math.ceil(p["range_rad"] / TURN_STEP_RAD) + 1
    total = 0.0
    for face in face_numbers(p).values():
        lines = (face["high_px"] - face["low_px"]) / LINES_PX
        kernel = len(edge_kernel(face["width_px"]))
        wide, narrow = (
            len(line_samples(half_px, face["width_px"]))
            for half_px in (p["search_px"], _HALF_PX)
        )
        rough = work.edges(lines / _sparse(face), wide, kernel)
        total += (turns + 1) * (rough + _LINE * work.CALLS)
        total += work.edges(lines, wide, kernel) + 2 * work.edges(lines, narrow, kernel)
    return total


def turned_round(face: JawFace) -> JawFace:
    """Return the same edge with its normal to the other side."""
    return JawFace(
        normal=(-face.normal[0], -face.normal[1]),
        offset_px=-face.offset_px,
        low_px=-face.high_px,
        high_px=-face.low_px,
    )


def _seen(
    image: FloatArray, whole: JawFace, at: Place, search_px: float
) -> Numbers | None:
    """Return an edge's numbers, its normal from bright to dark; None if too faint."""
    face = in_view(whole, image.shape, at, search_px)
    if face is None:
        return None
    for way in (face, turned_round(face)):
        numbers = calibrate(image, way, at)
        found = None if numbers is None else measure_face(image, numbers, at, _HALF_PX)
        if numbers is not None and found is not None:
            return {**numbers, "rms_px": found.rms_px}
    return None


def _rivalled(image: FloatArray, artifact: Artifact, target: Target) -> Failure | None:
    """Return the failure of edges that are mistaken for others within the search."""
    p = artifact.parameters
    for name, numbers in face_numbers(p).items():
        turn = target.theta_rad
        across = (
            numbers["normal_x"] * math.cos(turn) - numbers["normal_y"] * math.sin(turn),
            numbers["normal_x"] * math.sin(turn) + numbers["normal_y"] * math.cos(turn),
        )
        for share in (-_TRIED, 0.0, _TRIED):
            off = share * target.search_px
            at = (
                target.column + off * across[0],
                target.row - off * across[1],
                target.theta_rad,
            )
            found = measure_face(image, numbers, at, target.search_px)
            if found is None or abs(found.offset_px + off - numbers["offset_px"]) > (
                _SAME_PX
            ):
                return Failure("ambiguous", f"{name} is not the only such edge near")
    return None


def _sparse(numbers: Numbers) -> int:
    """Return how many lines to leave out for about `_ROUGH` to stay."""
    return max(1, int((numbers["high_px"] - numbers["low_px"]) / LINES_PX / _ROUGH))


def _misplaced(
    found: Mapping[str, MeasuredFace],
    faces: Mapping[str, Numbers],
    p: Numbers,
    guess: Guess,
    at: Place,
) -> Failure | None:
    """Return why the edges cannot be the target's, if they cannot."""
    for name, one in found.items():
        if one.rms_px > _BENT_PX + faces[name]["rms_px"]:
            return Failure("not_straight", f"{name} strays by {one.rms_px:.2f} px")
    return off_search(at, p, guess)


Numbers = Mapping[str, float]
Place = tuple[float, float, float]  # column, row, angle

_LOCKED_PX = 0.02  # edges along pixel rows share one sampling error; lines do not help


@dataclass(frozen=True, slots=True, kw_only=True)
class Fix:
    """Where the target is by its straight edges."""

    column: float
    row: float
    theta_rad: float
    grown_px: float  # how much farther out the edges are than predicted
    lines: float  # share of the lines that met their edges
    spread_px: float  # of the worst axis that is known
    spread_theta_rad: float

    def at_point(self) -> Measurement:
        """Return the measurement of a target known in both directions."""
        return Measurement(
            column=self.column,
            row=self.row,
            theta_rad=self.theta_rad,
            score=self.lines,
            spread_px=self.spread_px,
            spread_theta_rad=self.spread_theta_rad,
        )

    def across(self) -> Measurement:
        """Return that of a target known across its edges only."""
        return replace(self.at_point(), axis_rad=self.theta_rad)


def solve(
    found: Mapping[str, MeasuredFace], faces: Mapping[str, Numbers], *, breathes: bool
) -> tuple[FloatArray, FloatArray]:
    """Return (x, y, rotation, grown), (4,) px and rad, and its covariance, (4, 4).

    In the target's own frame, px with y up. A shift moves an edge's offset by its part
    along the normal; a rotation by t changes its slope by -t and the offset at the
    middle of its stretch by -t times that. What no edge tells is 0.
    """
    rows, right, residuals = [], [], []
    for name, one in found.items():
        f = faces[name]
        long = f["high_px"] - f["low_px"]
        weight = math.sqrt(one.lines)
        grown = float(breathes)
        row = np.array((f["normal_x"], f["normal_y"], -one.middle_px, grown))
        rows += [weight * row, weight * long / math.sqrt(12) * np.array((0, 0, -1, 0))]
        right.append(weight * (one.offset_px - f["offset_px"]))
        right.append(weight * long / math.sqrt(12) * (one.slope - f["slope"]))
        residuals.append(one.rms_px**2)
    design = np.array(rows)
    inverse = np.linalg.pinv(design.T @ design, rcond=1e-10, hermitian=True)
    change: FloatArray = inverse @ (design.T @ np.array(right))
    covariance = np.asarray(inverse * float(np.mean(residuals)), dtype=np.float64)
    return change, covariance


def moved(at: Place, change: FloatArray) -> Place:
    """Return the pose after a (4,) change in the target's own frame, px and rad."""
    dx, dy, turn = (float(v) for v in change[:3])
    c, s = math.cos(at[2]), math.sin(at[2])
    return (at[0] + c * dx - s * dy, at[1] - s * dx - c * dy, at[2] + turn)


def fix(
    at: Place,
    grown_px: float,
    covariance: FloatArray,
    found: Mapping[str, MeasuredFace],
    faces: Mapping[str, Numbers],
) -> Fix:
    """Return the pose with its standard deviations, by a (4, 4) covariance, px."""
    lines = sum(
        max(1.0, (f["high_px"] - f["low_px"]) / LINES_PX) for f in faces.values()
    )
    met = sum(one.lines for one in found.values())
    spread = math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
    long = max(f["high_px"] - f["low_px"] for f in faces.values())
    return Fix(
        column=at[0],
        row=at[1],
        theta_rad=math.remainder(at[2], 2 * math.pi),
        grown_px=grown_px,
        lines=min(1.0, met / lines),
        spread_px=math.hypot(spread, _LOCKED_PX),
        # an error of one sampling that runs from one end of the edge to the other
        spread_theta_rad=math.hypot(
            math.sqrt(float(covariance[2, 2])), _LOCKED_PX / long
        ),
    )
