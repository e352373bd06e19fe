"""Which aberrations stay: those put into sums of pictures, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.planner.calibration.estimates import Refused
from microplan.planner.calibration.through_focus.edge_picture import EdgePicture
from microplan.planner.calibration.through_focus.lens_normals import (
    FIRST,
    LensFit,
    StepNormals,
)
from microplan.planner.calibration.through_focus.wavefront_fit import (
    NOLLS,
    WavefrontTerm,
    fit_wavefront,
    sorted_terms,
)

STEPS, PIXELS, NOISE = 11, 10_000, 0.01
WAVES = 4e-4  # rms, the standard deviation of a term by one step


def drawn(true: FloatArray, rng: np.random.Generator) -> LensFit:
    """Return a fit's sums about no aberration, in noise, where there are `true` ones.

    Each step tells all numbers, some better than others; (P,) um, waves and shares.
    """
    steps = []
    for _ in range(STEPS):
        root = rng.normal(0, 1, (2 * len(true), len(true))) / WAVES
        normal = NOISE**2 * root.T @ root / (2 * len(true))
        noise = NOISE**2 * root.T @ rng.normal(0, 1, len(root)) / (2 * len(true)) ** 0.5
        steps.append(
            StepNormals(
                normal=normal,
                slope=noise - normal @ true,
                square=NOISE**2 * PIXELS,
                count=PIXELS,
            )
        )
    numbers = np.append([0.4, 0.0, 1.0], np.zeros(len(NOLLS)))
    return LensFit(nolls=NOLLS, numbers=numbers, steps=tuple(steps), wave_um=24.0)


def told(fit: LensFit) -> tuple[WavefrontTerm, ...]:
    return sorted_terms(fit)[0]


@pytest.mark.parametrize("count", [8, pytest.param(30, marks=pytest.mark.slow)])
def test_terms_put_in_are_told_within_their_deviations(count: int) -> None:
    true = np.zeros(FIRST + len(NOLLS))
    put = {6: 0.004, 8: -0.01, 11: 0.02}
    for noll, waves in put.items():
        true[FIRST + NOLLS.index(noll)] = waves
    pulls = []
    for seed in range(count):
        kept, dropped = sorted_terms(drawn(true, np.random.default_rng(seed)))
        assert {*put} <= {term.noll for term in kept}
        assert {t.noll for t in kept} | {t.noll for t in dropped} == {*NOLLS}
        for term in kept:
            assert term.waves.sigma
            off = term.waves.value - put.get(term.noll, 0.0)
            pulls.append(off / term.waves.sigma)
    # by Student's t of some 8 numbers 8/6; what is sampled is added and not there
    assert 0.5 < np.mean(np.square(pulls)) < 1.8


@pytest.mark.parametrize(
    ("count", "most"), [(40, 1), pytest.param(200, 4, marks=pytest.mark.slow)]
)
def test_a_lens_without_aberrations_has_none(count: int, most: int) -> None:
    """By sureness alone 2 % of series would have one of seven."""
    none = np.zeros(FIRST + len(NOLLS))
    lenses = (drawn(none, np.random.default_rng(k)) for k in range(count))
    assert sum(bool(told(lens)) for lens in lenses) <= most


def test_pictures_without_readings_are_refused() -> None:
    pictures: list[EdgePicture] = []
    found = fit_wavefront(pictures, np.array([0.4, 0.0, 1.0]))
    assert isinstance(found, Refused)
    assert found.why == "0 focus readings show it, 6 are needed"
    assert "signed focus readings" in found.take


def test_a_term_is_kept_only_if_steps_left_out_are_foretold_better() -> None:
    """One step alone, as dust on it, makes no term: all others contradict it."""
    rng = np.random.default_rng(1)
    fit = drawn(np.zeros(FIRST + len(NOLLS)), rng)
    odd, true = fit.steps[3], np.zeros(FIRST + len(NOLLS))
    true[-1] = 0.01
    steps = list(fit.steps)
    steps[3] = StepNormals(
        normal=odd.normal, slope=odd.slope - odd.normal @ true,
        square=odd.square, count=odd.count,
    )  # fmt: skip
    changed = LensFit(
        nolls=fit.nolls, numbers=fit.numbers, steps=tuple(steps), wave_um=24.0
    )
    assert not told(changed)
    assert not told(fit)


def test_pictures_that_tell_nothing_tell_no_aberration() -> None:
    """No number changes an image: equations have a solution all the same."""
    size = FIRST + len(NOLLS)
    empty = StepNormals(
        normal=np.zeros((size, size)), slope=np.zeros(size), square=0.0, count=PIXELS
    )
    fit = LensFit(
        nolls=NOLLS, numbers=np.append([0.4, 0.0, 1.0], np.zeros(len(NOLLS))),
        steps=(empty,) * STEPS, wave_um=24.0,
    )  # fmt: skip
    assert not told(fit)
