"""Heights by focus against the renderer's truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from featuresel.case import LookCase, scene
from featuresel.routines import Failure
from featuresel.routines.focus import FocusPeak, peak, ring_mask, score
from optics.render import render_stack
from optics.scene import Illumination

Look = Callable[[str], LookCase]


def sweep(
    case: LookCase, z_um: np.ndarray, expose: Callable[..., Any], seed: int
) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    dx, dy = rng.uniform(-1, 1, 2)
    images = render_stack(
        scene(case, dx, dy, 0.0),
        case.microscope,
        focus_um=tuple(z_um),
        window=case.window,
    )
    return [expose(case, image, rng) for image in images]


@pytest.mark.parametrize("step_um", [2.0, 5.0])
@pytest.mark.parametrize("name", ["bore", "post"])
def test_the_peak_is_at_the_face(
    name: str, step_um: float, look: Look, expose_image: Callable[..., Any]
) -> None:
    errors = []
    for seed in range(6):
        offset = step_um * (seed / 6 - 0.5)
        z = np.arange(-24, 24.1, step_um) + offset
        found = peak(z, [score(i) for i in sweep(look(name), z, expose_image, seed)])
        assert isinstance(found, FocusPeak)
        errors.append(found.z_um)
    # a 3-point parabola errs by .15-.6 um on 5 um steps: better than its best
    assert np.abs(errors).max() < 0.15


def test_a_ring_tells_the_post_from_the_gear_above(
    look: Look, expose_image: Callable[..., Any]
) -> None:
    case = look("over_shaft")  # the gear's top is 110 um above the post's
    radius = case.target.parameters["radius_um"] * case.target.px_per_um
    mask = ring_mask((200, 200), case.target.column, case.target.row, radius, 8.0)
    z = np.arange(-24, 24.1, 4.0)
    images = sweep(case, z, expose_image, 5)
    found = peak(z, [score(image, mask) for image in images])
    assert isinstance(found, FocusPeak)
    # the gear's light falls towards the post and tilts the curve by a part of a step
    assert abs(found.z_um) < 1.0


def test_the_lights_level_does_not_matter(look: Look) -> None:
    case = look("post")
    images = [
        render_stack(
            scene(case, 0, 0, 0),
            case.microscope,
            focus_um=(3.0,),
            window=case.window,
            light=Illumination(gain=gain),
        )[0]
        for gain in (0.5, 1.0)
    ]
    assert score(images[0]) == pytest.approx(score(images[1]), rel=1e-9)


def gaussian(z: np.ndarray, at: float, width: float) -> np.ndarray:
    return np.exp(-((z - at) ** 2) / (2 * width**2))


def test_a_gaussian_is_found_exactly_where_nothing_lies_below_it() -> None:
    z = np.arange(-60.0, 60.1, 4.0)
    found = peak(z, gaussian(z, 1.3, 7.0))
    assert isinstance(found, FocusPeak)
    assert found.z_um == pytest.approx(1.3, abs=1e-6)
    assert found.width_um == pytest.approx(7.0, rel=1e-6)
    assert found.sigma_um < 1e-5


def test_its_error_estimate_is_honest() -> None:
    z, rng = np.arange(-40.0, 40.1, 4.0), np.random.default_rng(7)
    errors, sigmas = [], []
    for _ in range(200):
        found = peak(z, 0.2 + gaussian(z, 0.7, 8) + 0.01 * rng.standard_normal(len(z)))
        assert isinstance(found, FocusPeak)
        errors.append(found.z_um - 0.7)
        sigmas.append(found.sigma_um)
    # few stops, so the estimate scatters; on average it is within a factor of two
    assert 0.5 < np.sqrt(np.mean(np.square(sigmas))) / np.std(errors) < 2


@pytest.mark.parametrize(
    ("scores", "code"),
    [
        ([1.0, 1.01, 1.02, 1.01, 1.0, 1.0], "flat"),
        ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "border"),
        ([6.0, 5.0, 3.0, 1.0, 1.0, 1.0], "border"),
        ([0.0, 5.0, 1.0, 5.0, 5.0, 0.0], "several_peaks"),
        ([0.0, 0.0, 0.0, 9.0, 0.0, 0.0], "coarse"),
        ([0.0, 1.0, 2.0, 1.0], "few_stops"),
    ],
)
def test_what_is_no_peak_is_refused(scores: list[float], code: str) -> None:
    found = peak(np.arange(len(scores), dtype=float), scores)
    assert isinstance(found, Failure)
    assert found.code == code


def test_nonsense_is_an_error() -> None:
    with pytest.raises(ValueError, match="finite"):
        peak([0, 1, 2, 3, 4], [0, 1, math.nan, 1, 0])
    with pytest.raises(ValueError, match="rise"):
        peak([0, 1, 1, 3, 4], [0, 1, 2, 1, 0])
    with pytest.raises(ValueError, match="as many"):
        peak([0, 1, 2], [0, 1])
    with pytest.raises(ValueError, match="black"):
        score(np.zeros((5, 5)))
    with pytest.raises(ValueError, match="mask"):
        score(np.ones((5, 5)), np.zeros((5, 5), dtype=bool))
