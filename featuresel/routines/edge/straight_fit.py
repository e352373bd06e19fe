"""Least squares over lines through straight edges: the pose they have together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import Measurement
from microplan.featuresel.routines.edge.faces import LINES_PX, MeasuredFace

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
    """Return (x, y, turn, grown), (4,) px and rad, and its covariance, (4, 4).

    In the target's own frame, px with y up. A shift moves an edge's offset by its part
    along the normal; a turn by t changes its slope by -t and the offset at the middle
    of its stretch by -t times that. What no edge tells is 0.
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
