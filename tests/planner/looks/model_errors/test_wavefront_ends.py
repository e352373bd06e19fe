"""What an objective's wavefront may be, by what is stated of it."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.optics.transfer.zernike import zernike
from microplan.planner.looks.model_errors.wavefront_ends import (
    FOCUSING,
    LIMITED,
    MOVING,
    SHARED,
    UNKNOWN,
    WAVEFRONT,
    total_share,
    unknown_focusing,
    unknown_wavefronts,
    wavefront_rows,
)
from microplan.planner.task.workcell import WavefrontSpec, ZernikeTerm

LIMIT = 0.002


def terms(*each: tuple[int, float, float]) -> WavefrontSpec:
    return WavefrontSpec(
        terms=tuple(
            ZernikeTerm(noll=noll, waves=waves, sigma_waves=sigma)
            for noll, waves, sigma in each
        )
    )


def test_the_share_holds_a_term_of_a_random_direction_in_95_percent() -> None:
    drawn = np.random.default_rng(4).normal(size=(200_000, SHARED))
    one = np.abs(drawn[:, 0]) / np.sqrt((drawn**2).sum(axis=1))
    inside = float((one <= total_share()).mean())
    assert inside == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / len(one)))


def test_a_diffraction_limited_lens_has_strehl_s_four_fifths() -> None:
    assert np.exp(-((2 * np.pi * LIMITED) ** 2)) == pytest.approx(0.8, abs=0.02)


def test_nothing_stated_is_a_diffraction_limited_lens() -> None:
    plain, same = WavefrontSpec(), WavefrontSpec(rms_waves=LIMITED)
    assert plain.known == ()
    assert unknown_wavefronts(plain) == unknown_wavefronts(same)
    assert unknown_wavefronts(plain) == tuple(
        ((noll, total_share() * LIMITED),) for noll in MOVING
    )


def test_a_total_is_shared_in_proportion_and_none_is_none() -> None:
    ends = unknown_wavefronts(WavefrontSpec(rms_waves=0.05))
    wide = unknown_wavefronts(WavefrontSpec(rms_waves=0.1))
    for (one,), (other,) in zip(ends, wide, strict=True):
        assert other[0] == one[0]
        assert other[1] == pytest.approx(2 * one[1])
    assert unknown_wavefronts(WavefrontSpec(rms_waves=0.0)) == ()


def test_stated_terms_are_known_but_for_their_sigma() -> None:
    stated = terms((7, -0.02, 0.0), (8, 0.03, 0.01), (11, 0.04, 0.02))
    assert stated.known == ((7, -0.02), (8, 0.03), (11, 0.04))
    (end,) = unknown_wavefronts(stated)  # spherical aberration moves nothing
    assert dict(end) == {7: -0.02, 8: pytest.approx(0.03 + 1.96 * 0.01), 11: 0.04}
    assert unknown_wavefronts(terms((8, 0.03, 0.0))) == ()


def test_coma_and_trefoil_of_any_order_count() -> None:
    """Noll 16 and 17 are coma of the next order, 18 and 19 trefoil; 20 has five."""
    stated = terms(*((noll, 0.0, 0.01) for noll in range(12, 23)))
    moving = [dict(end) for end in unknown_wavefronts(stated)]
    assert [max(each, key=lambda n: each[n]) for each in moving] == [
        *(16, 17, 18, 19, 20, 21)
    ]


@pytest.mark.parametrize(
    ("stated", "known", "unknown", "words"),
    [
        (WavefrontSpec(), False, True, "state `wavefront`"),
        (WavefrontSpec(rms_waves=0.05), False, True, "0.05 waves rms in all"),
        (WavefrontSpec(rms_waves=0.0), False, False, "none"),
        (terms((8, 0.03, 0.01)), True, True, "0.03 of Noll 8"),
        (terms((8, 0.03, 0.0)), True, False, "0.03 of Noll 8"),
        (terms(), False, False, "none"),
    ],
)
def test_rows_are_open_as_far_as_there_is_anything(
    stated: WavefrontSpec, known: bool, unknown: bool, words: str
) -> None:
    rows = wavefront_rows(stated, LIMIT)
    assert [row.effect for row in rows] == [WAVEFRONT, UNKNOWN]
    assert [row.predicted_error is None for row in rows] == [False, unknown]
    levels = ["imaged" if known else "off", "not modelled" if unknown else "off"]
    assert [row.level for row in rows] == levels
    assert words in " ".join(row.reason for row in rows)


def test_what_moves_the_focus_is_alike_at_opposite_points_of_the_pupil() -> None:
    half = total_share() * LIMITED
    assert unknown_focusing(WavefrontSpec()) == dict.fromkeys((5, 6, 11), half)
    assert unknown_focusing(WavefrontSpec(rms_waves=0.0)) == {}
    rng = np.random.default_rng(2)
    x, y = rng.uniform(-0.7, 0.7, (2, 50))
    for noll in (*FOCUSING, *MOVING):
        sign = 1 if noll in FOCUSING else -1
        np.testing.assert_allclose(zernike(noll, -x, -y), sign * zernike(noll, x, y))


def test_all_stated_terms_with_a_sigma_may_move_the_focus() -> None:
    found = unknown_focusing(terms((8, 0.03, 0.01), (11, 0.04, 0.02), (22, 0.1, 0.0)))
    assert found == pytest.approx({8: 1.96 * 0.01, 11: 1.96 * 0.02})
