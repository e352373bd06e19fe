"""Heights by focus against the renderer's truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from microplan.featuresel.look.scenario import LookCase, scene
from microplan.featuresel.routines.focus.measures import ring_mask, tenengrad
from microplan.featuresel.routines.focus.peak import FocusPeak, mirror_peak
from microplan.optics.render.render import render_stack

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


@pytest.mark.parametrize(
    ("step_um", "most_um"),
    # 5 um is about the peak's width, which leaves .015 of it undrawn, one standard
    # deviation: 3 of them; 2 um leaves nothing and the camera 10 nm: 5 of them
    [(5.0, 0.24), (2.0, 0.05)],
)
@pytest.mark.parametrize("name", ["bore", "post"])
def test_the_peak_is_at_the_face(
    name: str,
    step_um: float,
    most_um: float,
    look: Look,
    expose_image: Callable[..., Any],
) -> None:
    for seed in range(6):
        offset = step_um * (seed / 6 - 0.5)
        z = np.arange(-24, 24.1, step_um) + offset
        found = mirror_peak(
            z, [tenengrad(i) for i in sweep(look(name), z, expose_image, seed)]
        )
        assert isinstance(found, FocusPeak)
        assert abs(found.z_um) < most_um


def test_a_ring_tells_the_post_from_the_gear_above(
    look: Look, expose_image: Callable[..., Any]
) -> None:
    case = look("over_shaft")  # the gear's top is 110 um above the post's
    radius = case.target.parameters["radius_um"] * case.target.px_per_um
    mask = ring_mask((200, 200), case.target.column, case.target.row, radius, 8.0)
    z = np.arange(-24, 24.1, 4.0)
    images = sweep(case, z, expose_image, 5)
    found = mirror_peak(z, [tenengrad(image, mask) for image in images])
    assert isinstance(found, FocusPeak)
    # the gear's light falls towards the post and tilts the curve by a part of a step
    assert abs(found.z_um) < 1.0


def test_a_ring_is_the_pixels_near_a_circle() -> None:
    mask = ring_mask((41, 61), 30.0, 20.0, 10.0, 1.5)
    rows, columns = np.nonzero(mask)
    away = np.abs(np.hypot(columns - 30, rows - 20) - 10)
    assert away.max() <= 1.5
    # pi (11.5^2 - 8.5^2) pixels, each border wrong by less than its length
    assert abs(mask.sum() - 60 * np.pi) < 2 * np.pi * 20
