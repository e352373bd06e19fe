"""The simulated lens: its systematic errors move what the camera sees."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from microplan.executor.simulated.cell import build_cell
from microplan.executor.simulated.imaging.imaging_view import TrueLensErrors
from microplan.executor.simulated.lens import MAX_DISTORTION, drawn_errors
from microplan.schemas.files.world import World, WorldLens
from tests.executor.bench import quiet, world

GEAR_UM = 200.0  # where the gear is, right of the axis
# the mean of d r**3 over a disc of radius w, of which the outer side is stretched, is
# d r (r**2 + 3 w**2)
MEAN_SQUARE = GEAR_UM**2 + 3 * 50.0**2
HALF_UM = 7.5 / 6.9 * math.hypot(640, 480) / 2  # half the field's diagonal


def cell_with(lens: WorldLens) -> World:
    """Return a world without other errors, the gear off the axis."""
    found = quiet(world())
    there = found.stage.start.x_um
    assert there is not None
    start = replace(found.stage.start, x_um=there + GEAR_UM)
    return replace(
        found,
        stage=replace(found.stage, start=start),
        optics=replace(found.optics, lens=lens, full_well_e=1e6, bits=16),
    )


def centroid_um(lens: WorldLens, focus_um: float = 0.0) -> float:
    """Return how far right of the axis the gear's light lies."""
    cell = build_cell(cell_with(lens), 0)
    cell.lens.set_focus_um(focus_um)
    counts = cell.camera.grab().counts.astype(float)
    # the gear is the brightest by far; out of focus it has no flat top
    light = np.clip(counts - (counts.max() + 3 * np.median(counts)) / 4, 0, None)
    light[:, : 320 + round(GEAR_UM / 2 * 6.9 / 7.5)] = 0
    column = float(light.sum(axis=0) @ np.arange(640) / light.sum())
    return (column - 319.5) * 7.5 / 6.9


@pytest.mark.parametrize(
    ("lens", "focus_um", "moved_um"),
    [
        (WorldLens(distortion=0.03), 0.0, 0.03 * GEAR_UM * MEAN_SQUARE / HALF_UM**2),
        (WorldLens(scale_per_um=1e-4), -60.0, 1e-4 * 60 * GEAR_UM),
        (WorldLens(lateral_um_per_um=(0.05, 0.0)), -60.0, 3.0),
    ],
)
def test_a_known_error_moves_the_gear(
    lens: WorldLens, focus_um: float, moved_um: float
) -> None:
    """Focus is so far below the gear's face as the second number says."""
    truth = build_cell(cell_with(lens), 0).truth
    focus_um += truth.top_um(truth.bodies["gear"])
    shown = centroid_um(lens, focus_um) - centroid_um(WorldLens(), focus_um)
    # the gear is a disc but for its teeth, the light above a threshold not all of it
    assert shown == pytest.approx(moved_um, rel=0.05)


def test_what_is_not_known_differs_from_cell_to_cell() -> None:
    sigma = WorldLens(distortion_sigma=0.002, scale_sigma_per_um=1e-6)
    drawn = [drawn_errors(sigma, np.random.default_rng(seed)) for seed in range(400)]
    for name, wanted in (("distortion", 0.002), ("scale_per_um", 1e-6)):
        values = np.array([getattr(errors, name) for errors in drawn])
        # the standard error of a standard deviation of n draws is 1 / sqrt(2 n) of it
        assert np.std(values) == pytest.approx(wanted, rel=4 / math.sqrt(800))
    none = drawn_errors(WorldLens(), np.random.default_rng(0))
    assert none == TrueLensErrors()
    wild = WorldLens(distortion=0.2, distortion_sigma=1.0)
    most = [
        abs(drawn_errors(wild, np.random.default_rng(s)).distortion) for s in (0, 1)
    ]
    assert max(most) <= MAX_DISTORTION


def test_coaxial_light_is_shaded_in_the_cell() -> None:
    """A gear 100 um above the stage darkens the stage about it, not itself."""
    plain = cell_with(WorldLens())
    lit = replace(plain, optics=replace(plain.optics, lamp_share=1.0))
    frames = []
    for found in (plain, lit):
        cell = build_cell(found, 0)
        top_um = cell.truth.top_um(cell.truth.bodies["gear"])
        cell.lens.set_focus_um(top_um)
        frames.append(cell.camera.grab().counts.astype(float))
    dark = frames[1] / frames[0]
    column = round(319.5 + GEAR_UM * 6.9 / 7.5)
    on_gear = dark[236:244, column + 30 : column + 38].mean()  # 37 um off its middle
    beside = dark[236:244, column + 50 : column + 54].mean()  # 6 um beside it
    far = dark[:20, :20].mean()
    assert on_gear == pytest.approx(1.0, abs=0.01)
    assert far == pytest.approx(1.0, abs=0.01)
    # beside a half plane half is lost; the gear is a ring as wide as half the cone
    assert 0.5 < beside < 0.85
