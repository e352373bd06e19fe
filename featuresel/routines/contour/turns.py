"""Which turn of a symmetry a part has, by the few edges that break it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contour.model import ROUND, rim_px
from microplan.featuresel.routines.contour.search import Field, ScoredPose, scan, score
from microplan.featuresel.routines.contract import Artifact, Failure

_RUNNER_UP = 0.6  # of the best turn's score, the most the second may reach
_LEAST = 0.35  # of the whole contour's score: where nothing is, it is 0
_SAME_PX = 3.0  # of the farthest edge: turns by less are not rivals


def choose_turn(
    fine: Field, artifact: Artifact, points: FloatArray, pose: ScoredPose
) -> ScoredPose | Failure:
    """Return the pose at the one turn that the symmetry's breach confirms.

    Points are (N, 4) px.
    """
    p = artifact.parameters
    breaking = points[artifact.arrays["breaking"] > 0]
    angles = list(_turned(p, pose, breaking))
    if len(angles) < 2 or not len(breaking):
        return pose
    whole = max(score(fine, points, pose.column, pose.row, pose.theta_rad), 1e-9)
    scores = scan(fine, breaking, pose, angles) / whole
    best = int(scores.argmax())
    # neighbours of the best angle are no rivals
    away = np.abs([math.remainder(a - angles[best], 2 * math.pi) for a in angles])
    rim = rim_px(breaking)
    others = scores[away * rim > _SAME_PX]
    second = max(float(others.max()), 0.0) if len(others) else 0.0
    if scores[best] < _LEAST:
        return Failure(
            "no_notch",
            f"what breaks the symmetry scores {scores[best]:.3f}, at least {_LEAST}",
        )
    if second > _RUNNER_UP * scores[best]:
        return Failure(
            "ambiguous",
            f"two turns of the symmetry score {scores[best]:.3f} and {second:.3f}",
        )
    return ScoredPose(
        column=pose.column, row=pose.row, theta_rad=angles[best], score=pose.score
    )


def _turned(
    p: Mapping[str, float], pose: ScoredPose, breaking: FloatArray
) -> Iterator[float]:
    """Yield the angles, within the range, that look alike but for the breach."""
    order = int(p["order"])
    if order == ROUND:  # half a sample apart, where the breach is
        rim = rim_px(breaking)
        order = math.ceil(2 * math.pi * rim * 2)
    limit = p["range_rad"] * 1.2 + 0.01
    for k in range(order):
        angle = pose.theta_rad + 2 * math.pi * k / order
        if abs(math.remainder(angle - p["theta_rad"], 2 * math.pi)) <= limit:
            yield angle
