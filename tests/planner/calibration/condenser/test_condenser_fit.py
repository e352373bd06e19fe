"""What profiles at several settings tell, and what they do not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.special import erf

from microplan.arrays import FloatArray
from microplan.planner.calibration.condenser.coherent_profiles import (
    CoherentProfiles,
    moved_out,
    nodes_about,
)
from microplan.planner.calibration.condenser.condenser_fit import (
    CondenserFit,
    CondenserLook,
    fit_condenser,
)
from microplan.planner.calibration.estimates import Refused
from microplan.planner.calibration.through_focus.edge_profile import across_px

OFFSET_PX, RATIO = 0.2, 0.35


def edges(coherence: float, blur: float) -> FloatArray:
    """Return a white part and a black one, (2, L): steep if coherent."""
    x = across_px() + 0.3 * np.exp(-coherence)
    own = (1 - erf(x / (1.5 + coherence + blur))) / 2
    return np.stack([own, 1 - own - 0.2 * np.exp(-(x**2) / 4) * np.exp(-coherence)])


def table() -> CoherentProfiles:
    nodes = np.array(nodes_about(0.25, 0.9))
    some = nodes[[0, 3, 6]]
    sharp, blurred = (np.array([edges(s, b) for s in nodes]) for b in (0.0, 0.5))
    at = [0, 3, 6]
    none = np.zeros((3, 2, len(across_px())))
    return CoherentProfiles.of(nodes, sharp, some, (blurred[at] - sharp[at], none))


def looks(
    true: dict[float, float],
    *,
    places: int = 6,
    noise: float = 1e-4,
    defocus: float = 0.0,
    ratio: float = RATIO,
) -> list[CondenserLook]:
    """Return profiles of settings as read, by their true coherence."""
    rng, known = np.random.default_rng(1), table()
    found = []
    for place in range(places):
        for setting, coherence in true.items():
            light = 0.8 * known(coherence, ratio, defocus, OFFSET_PX)
            seen = light + noise * rng.standard_normal(len(light))
            found.append(CondenserLook(place=str(place), setting=setting, profile=seen))
    return found


def fitted(some: list[CondenserLook]) -> CondenserFit:
    found = fit_condenser(some, table())
    assert isinstance(found, CondenserFit), found
    return found


def test_a_common_factor_and_the_offset_come_out() -> None:
    found = fitted(looks({0.3: 0.33, 0.7: 0.77}))
    assert not found.each_its_own
    for setting in found.settings:
        assert found.coherence(setting).value == pytest.approx(1.1 * setting, rel=3e-3)
    assert found.offset_px.value == pytest.approx(OFFSET_PX, abs=3e-3)
    assert found.ratio.value == pytest.approx(RATIO, abs=1e-3)
    assert found.offset_px.sigma is not None


def test_a_setting_that_reads_wrong_stands_alone() -> None:
    found = fitted(looks({0.3: 0.3, 0.5: 0.5, 0.7: 0.85}))
    assert found.each_its_own
    assert found.coherence(0.7).value == pytest.approx(0.85, rel=0.01)
    assert found.coherence(0.3).value == pytest.approx(0.3, rel=0.01)


def test_few_places_have_no_deviation_and_one_common_factor() -> None:
    found = fitted(looks({0.3: 0.3, 0.7: 0.7}, places=3))
    assert found.offset_px.sigma is None
    single = fitted(looks({0.3: 0.3, 0.7: 0.7}, places=1))
    assert single.coherence(0.3).sigma is None
    assert "own" not in single.better


@pytest.mark.parametrize(
    ("true", "other", "said"),
    [
        ({0.3: 0.3}, {}, "1 setting of the condenser"),
        ({0.3: 0.3, 0.33: 0.33}, {}, "too close"),
        ({0.3: 0.3, 0.7: 0.7}, {"defocus": 0.7}, "out of focus by 0.21 waves"),
        ({0.3: 0.3, 0.7: 0.7}, {"ratio": 0.95}, "too faint: amplitudes are 1 to 0.95"),
        ({0.3: 0.3, 0.7: 0.7}, {"noise": 0.1, "places": 2}, "images are off by"),
        ({0.2: 0.05, 0.7: 0.3}, {}, "an end of the"),
        ({0.3: 0.3, 0.5: 0.5, 0.7: 0.85}, {"places": 4}, "share no factor"),
    ],
)
def test_what_is_not_told_is_refused(
    true: dict[float, float], other: dict[str, Any], said: str
) -> None:
    found = fit_condenser(looks(true, **other), table())
    assert isinstance(found, Refused)
    assert said in found.why
    assert "two settings of the condenser" in found.take


def test_profiles_are_moved_outwards() -> None:
    away = moved_out(edges(0.5, 0.0), 1.0)
    np.testing.assert_allclose(away[:, 2:], edges(0.5, 0.0)[:, :-2], atol=1e-9)


def test_a_table_reaches_beyond_its_settings() -> None:
    nodes = nodes_about(0.24, 0.75)
    assert nodes[0] < 0.24
    assert nodes[-1] > 0.75
    assert nodes == sorted(nodes)
