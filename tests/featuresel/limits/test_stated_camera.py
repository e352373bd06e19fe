"""Measured with a camera that bends, cuts darkness off and has its own noise.

Its noise falls with the light, as that of machine-vision cameras with a response does;
most of the ground is exactly 0.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.featuresel.limits.crlb import limit_um
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.perturb import counts, image
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.trials import (
    PreparedRoutines,
    measure_picture,
    prepare,
)
from microplan.optics.lens.response import Response, power_rows
from microplan.optics.lens.sensor import Sensor
from tests.featuresel.conftest import CASES

NOISE = ((8.0, 25.0), (90.0, 17.6), (149.0, 10.2), (207.0, 4.4), (237.0, 1.7))
BLACK = -188.0  # the ground, .15 of full scale, would give -2 counts
DRAWS = 60
CHAINS = [("likelihood",), ("ncc",), ("contour_match",)]


@cache
def stated() -> LookCase:
    response = Response.from_levels(power_rows(0.45), black=BLACK, white=247.0)
    sensor = Sensor(
        full_well_e=1, read_noise_e=0, bits=8, response=response, noise=NOISE
    )
    return replace(CASES["post"](), sensor=sensor)


@cache
def prepared() -> PreparedRoutines:
    return prepare(stated(), CHAINS)


def drawn(k: int) -> Trial:
    rng = np.random.default_rng(k)
    dx, dy = (stated().microscope.um_per_px * rng.uniform(-0.5, 0.5, 2)).tolist()
    return Trial(
        index=k, dx_um=dx, dy_um=dy, dtheta_rad=0.0, model=stated().model, seed=(k,)
    )


@cache
def errors(chain: tuple[str, ...]) -> FloatArray:
    """Return errors of a chain on noisy images, (DRAWS, 2) um."""
    only = replace(prepared(), chains=(chain,))
    found = []
    for k in range(DRAWS):
        (outcome,) = measure_picture(
            stated(), only, drawn(k), image(stated(), drawn(k))
        )
        assert outcome.failure is None, outcome
        found.append(outcome.target_um)
    return np.array(found, dtype=np.float64)


def test_most_of_the_ground_is_cut_off() -> None:
    frame = counts(stated(), drawn(0))
    assert 0.4 < (frame == 0).mean() < 0.9
    assert frame.max() > 150


def test_the_fit_reaches_the_limit_of_that_camera() -> None:
    """Within four standard errors of a standard deviation of 120 values."""
    known = limit_um(stated())
    assert known is not None
    found = errors(CHAINS[0])
    rms = math.sqrt((found**2).mean())
    assert rms == pytest.approx(known, rel=4 / math.sqrt(2 * found.size))


@pytest.mark.parametrize("chain", CHAINS)
def test_no_chain_is_biased_by_the_response(chain: tuple[str, ...]) -> None:
    found = errors(chain)
    mean, sigma = found.mean(axis=0), found.std(axis=0, ddof=1)
    assert (np.abs(mean) < 4 * sigma / math.sqrt(DRAWS) + 0.003).all()
    assert sigma.max() < 0.1
