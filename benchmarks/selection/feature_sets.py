"""Is the chosen set of features the best of its size? Greedy with exchange, and all.

Sets of points, edges and features with an angle of their own are drawn at random; every
set of the size is tried for comparison.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from microplan.featuresel.sets.feature_set import MARGIN, SetSearch
from microplan.featuresel.sets.pose_covariance import (
    FeatureMeasurement,
    PoseRequirement,
    covariance,
)

COUNT = 1000
SEED = 14
FEATURES = 12
SIZES = (2, 3, 4)
_RADIUS_UM = 50.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """One random problem: how much less the chosen set tells than the best."""

    lost: float  # of log det
    search_s: float
    all_s: float


def judge(number: int) -> Found:
    """Return what the search loses on one random problem."""
    rng = np.random.default_rng(np.random.SeedSequence([SEED, number]))
    sights = [_sight(rng, k) for k in range(FEATURES)]
    angle = 0.1 if number % 2 else None
    need = PoseRequirement(sigma_um=1.0, sigma_theta_rad=angle, radius_um=_RADIUS_UM)
    size = SIZES[number % len(SIZES)]
    start = time.process_time()
    taken = SetSearch.of(sights, need).best_of(size)
    middle = time.process_time()
    best = max(log_det(some, need) for some in itertools.combinations(sights, size))
    end = time.process_time()
    told = log_det([sights[k] for k in taken], need)
    lost = max(best - told, 0.0) if best > told else 0.0  # both may be blind
    return Found(lost=lost, search_s=middle - start, all_s=end - middle)


def log_det(sights: Sequence[FeatureMeasurement], need: PoseRequirement) -> float:
    """Return -log det of the covariance of what is wanted, um; -inf if it is blind."""
    wanted = 2 if need.sigma_theta_rad is None else 3
    found = covariance(sights, need.radius_um)[:wanted, :wanted]
    if not np.isfinite(found).all():
        return -math.inf
    return -float(np.linalg.slogdet(found)[1])


def _sight(rng: np.random.Generator, number: int) -> FeatureMeasurement:
    """Return a random feature of a part; spreads go over two decades."""
    x, y = rng.uniform(-_RADIUS_UM, _RADIUS_UM, 2)
    edge, turned = rng.random(2) < (0.4, 0.2)
    return FeatureMeasurement(
        name=f"feature{number:02}",
        x_um=float(x),
        y_um=float(y),
        sigma_um=float(np.exp(rng.uniform(-4.6, 0))),
        axis_rad=float(rng.uniform(0, math.pi)) if edge else None,
        sigma_theta_rad=float(np.exp(rng.uniform(-7, -2))) if turned else None,
        cost=1.0,
    )


def _measure(_options: Options) -> Iterator[Figure]:
    """Yield how often another set tells more, and by how much at most."""
    found = [judge(k) for k in range(COUNT)]
    equal = sum(f.lost <= MARGIN for f in found) / COUNT
    search_s, all_s = (sum(getattr(f, n) for f in found) for n in ("search_s", "all_s"))
    yield Figure(name="feature_sets.best_share", value=equal, unit="1")
    yield Figure(
        name="feature_sets.most_lost", value=max(f.lost for f in found), unit="1"
    )
    yield Figure(
        name="feature_sets.ms",
        value=1e3 * search_s / COUNT,
        unit="ms",
        rival=1e3 * all_s / COUNT,
    )


BENCHMARK = Benchmark(
    names=("feature_sets.best_share", "feature_sets.most_lost", "feature_sets.ms"),
    measure=_measure,
)
