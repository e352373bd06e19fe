"""Scores of many shifts against those of one pose after the other."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.featuresel.routines.contour import search as contour_search
from microplan.featuresel.routines.contour.search import (
    ScoredPose,
    field,
    score,
    search,
)

ANGLES = np.array([-0.1, 0.0, 0.1])


def ring(count: int, radius_px: float) -> np.ndarray:
    """Return points of a bright disc, some weights larger than others."""
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    x, y = np.cos(turn), 0.8 * np.sin(turn)  # not round: turns tell
    return np.stack(
        (radius_px * x, radius_px * y, -x, -y, 1 + 0.2 * np.cos(turn)), axis=1
    )


@pytest.mark.parametrize("near", [(50.3, 41.6), (12.0, 70.0), (-30.0, 40.0)])
def test_all_shifts_at_once_score_as_one_after_the_other(
    near: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the middle, where the search leaves the image, and all but out of it."""
    rng = np.random.default_rng(1)
    image = rng.normal(0.5, 0.05, (90, 104))
    y, x = np.mgrid[:90, :104]
    image[np.hypot(x - 57, (y - 44) / 0.8) < 20] += 0.3
    points, found = ring(160, 20.0), field(image, 2, 0.05)
    seen: list[bool] = []
    fast = contour_search._correlated

    def watched(*args: object) -> np.ndarray:
        seen.append(True)
        return fast(*args)  # type: ignore[arg-type]

    def poses() -> tuple[ScoredPose, ...]:
        return search(found, points, near, 40.0, ANGLES, closed=False)

    monkeypatch.setattr(contour_search, "_correlated", watched)
    several = poses()
    assert seen  # this many shifts are transformed
    monkeypatch.setattr(contour_search, "_MANY", np.inf)
    for one, other in zip(several, poses(), strict=True):
        assert (one.column, one.row) == (other.column, other.row)
        assert one.theta_rad == other.theta_rad
        assert one.score == pytest.approx(other.score, abs=1e-14)
    best = several[0]
    own = score(found, points, best.column, best.row, best.theta_rad)
    assert best.score == pytest.approx(own, abs=1e-12)
