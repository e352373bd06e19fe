"""What discrepancies of pictures do to answers, and what fits say of themselves."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.featuresel.look.design import Trial, random_design
from microplan.featuresel.look.discrepancy import Discrepancy
from microplan.featuresel.look.nominal import target_contrast
from microplan.featuresel.look.perturb import exposed, image
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.repeatability import repeatability
from microplan.featuresel.trials.trials import (
    PreparedRoutines,
    measure_picture,
    prepare,
)
from microplan.optics.lens.sensor import expose, linear
from tests.featuresel.conftest import CASES

FIT = ("likelihood",)
FROM_AFAR = ("ncc", "likelihood")
DRAWS = 40


@cache
def case() -> LookCase:
    found = CASES["post"]()
    scope = found.microscope
    size = Discrepancy(
        edge=0.03,
        flat=0.01,
        pixel=0.03 * target_contrast(found),
        fine_um=scope.wavelength_um / scope.aperture,
        size_um=found.target.size_um,
    )
    return replace(found, discrepancy=size)


@cache
def prepared() -> PreparedRoutines:
    return prepare(case(), [FIT, FROM_AFAR])


def trial(k: int) -> Trial:
    return Trial(
        index=k, dx_um=0.0, dy_um=0.0, dtheta_rad=0.0, model=case().model, seed=(k,)
    )


def measured(picture: FloatArray, chain: tuple[str, ...] = FIT) -> Outcome:
    only = replace(prepared(), chains=(chain,))
    (outcome,) = measure_picture(case(), only, trial(0), picture)
    assert outcome.failure is None, outcome
    return outcome


def test_a_fit_says_how_far_it_repeats_and_not_how_true_it_is() -> None:
    """One discrepancy, other noise each time: three in four tests of 80 values pass.

    Four standard errors of a standard deviation of 80 values are 32 %.
    """
    _, more = exposed(case(), trial(5))
    still = image(replace(case(), discrepancy=None), trial(5))
    places, spreads = [], []
    for k in range(DRAWS):
        frame = expose(still + more, case().sensor, np.random.default_rng(k))
        outcome = measured(linear(frame, case().sensor))
        places.append(outcome.world_um)
        spreads.append(outcome.spread_um or math.nan)
    sigma = np.array(places).std(axis=0, ddof=1)
    rms = math.sqrt((sigma**2).mean())
    # the frame has the noise of one more image in it, the same each time
    assert np.mean(spreads) == pytest.approx(rms, rel=4 / math.sqrt(4 * DRAWS))


@pytest.mark.parametrize("angle_rad", [0.3, 2.0, 4.1])
def test_dust_on_an_edge_decides_neither_place_nor_score(angle_rad: float) -> None:
    """A speck of 8 px on the rim of 40 px: an eighth of it is another thing."""
    picture, at = image(case(), trial(3)), case().target
    radius_px = at.parameters["radius_um"] * at.px_per_um
    row, column = np.indices(picture.shape)
    off = np.hypot(
        column - at.column - radius_px * math.cos(angle_rad),
        row - at.row + radius_px * math.sin(angle_rad),
    )
    clean, dusty = measured(picture), measured(np.where(off < 4, 0.02, picture))
    moved = np.subtract(dusty.world_um or math.nan, clean.world_um or math.nan)
    assert np.hypot(*moved) < 4 * (clean.spread_um or 0.0)
    assert (dusty.score or 0.0) > 0.875 * (clean.score or 1.0)


def test_saturated_pixels_decide_no_score() -> None:
    """A bright spot on the post: of its pixels nothing is known but that they are."""
    picture, at = image(case(), trial(3)), case().target
    row, column = np.indices(picture.shape)
    radius_px = at.parameters["radius_um"] * at.px_per_um
    off = np.hypot(column - at.column - radius_px + 1, row - at.row)
    clean, bright = measured(picture), measured(np.where(off < 4, 1.0, picture))
    assert (bright.score or 0.0) > 0.875 * (clean.score or 1.0)
    assert bright.spread_um == pytest.approx(clean.spread_um, rel=0.2)


@pytest.mark.parametrize(("gamma", "black"), [(0.6, 0.0), (1.5, 0.0), (1.0, -0.12)])
def test_levels_that_nobody_stated_decide_neither_place_nor_score(
    gamma: float, black: float
) -> None:
    seen = replace(case(), discrepancy=None)
    sure = replace(seen.sensor, full_well_e=1e9, read_noise_e=0.0, bits=16)
    light = image(replace(seen, sensor=sure), trial(3))

    def photo(level: FloatArray) -> FloatArray:
        frame = expose(level, seen.sensor, np.random.default_rng(3))
        return linear(frame, seen.sensor)

    clean = measured(photo(light))
    odd = measured(photo(np.clip((1 - black) * light**gamma + black, 0.0, 1.0)))
    moved = np.subtract(odd.world_um or math.nan, clean.world_um or math.nan)
    # a bent response moves the middle of a round edge by no more than noise does
    assert np.hypot(*moved) < 4 * (clean.spread_um or 0.0)
    assert (odd.score or 0.0) > 0.9 * (clean.score or 1.0)


def test_a_post_without_a_quarter_of_its_rim_is_another_thing() -> None:
    picture, at = image(case(), trial(3)), case().target
    row, column = np.indices(picture.shape)
    turn = np.arctan2(row - at.row, column - at.column)
    beside = np.median(picture[:4])
    cut = np.where(np.abs(turn) < math.pi / 4, beside, picture)
    outcome, _ = measure_picture(case(), prepared(), trial(0), cut)
    assert outcome.failure == "misfit" or (outcome.score or 1.0) < 0.5


def place(picture: FloatArray) -> FloatArray:
    """Return where the target is found from afar, (2,) um off its place."""
    return np.array(measured(picture, FROM_AFAR).world_um, dtype=np.float64)


def test_trueness_is_what_pictures_without_noise_differ_by() -> None:
    found = repeatability(case(), prepared(), [FROM_AFAR], count=DRAWS, root_seed=4)
    sure = replace(case().sensor, full_well_e=1e9, read_noise_e=0.0, bits=16)
    quiet = replace(case(), sensor=sure)
    plain = replace(quiet, discrepancy=None)
    telling = [o.trial for o in found.outcomes if o.moved_um is not None]
    assert len(telling) == DRAWS // 2
    trials = random_design(case(), DRAWS, 4)
    moved = [
        place(image(quiet, trials[at])) - place(image(plain, trials[at]))
        for at in telling
    ]
    expected = np.sqrt(np.square(moved).mean(axis=0))
    told = np.array(found.true(FROM_AFAR).um, dtype=np.float64)
    # noise moves either answer alike, but for where it weighs pixels otherwise
    np.testing.assert_allclose(told, expected, rtol=0.1)


def test_without_discrepancy_nothing_is_moved() -> None:
    plain = replace(case(), discrepancy=None)
    found = repeatability(plain, prepared(), [FROM_AFAR], count=4, root_seed=4)
    assert found.true(FROM_AFAR).um is None
