"""Rays of all cells at once: what each meets of a sheet."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.optics.layers.rays import Fan, LayerSheet, trace

SHAPE = (7, 9)
TANGENTS = np.array([[0.0, 0.0], [0.3, -0.1], [-0.24, 0.2], [0.3, -0.1]])
FAN = Fan(shape=SHAPE, step_um=0.5, tangents=TANGENTS, focus_um=2.0)


def raster(seed: int, rim: int = 5) -> np.ndarray:
    shape = tuple(side + 2 * rim for side in SHAPE)
    return np.random.default_rng(seed).random(shape).astype(np.float32)


@pytest.mark.parametrize("z_um", [2.0, 9.0, -4.5])
def test_the_mean_is_that_of_all_views(z_um: float) -> None:
    own = raster(1)
    views = FAN.views(own, z_um)
    assert [view.shape for view in views] == [SHAPE] * len(TANGENTS)
    np.testing.assert_allclose(FAN.mean(own, z_um), np.mean(views, axis=0), atol=1e-6)


def test_a_ray_meets_what_lies_at_its_height_times_its_slope() -> None:
    own = np.zeros((17, 19), dtype=np.float32)
    own[8, 9] = 1.0  # the middle
    _, right, *_ = FAN.views(own, 7.0)  # 3 cells to the right, 1 down
    row, column = np.argwhere(right)[0]
    assert (row, column) == (3 - 1, 4 - 3)


def test_an_image_is_laid_ray_by_ray() -> None:
    sheets = [
        LayerSheet(z_um=z_um, covers=raster(k), sends=0.4 * raster(k))
        for k, z_um in ((1, 3.0), (2, 8.0))
    ]
    seen = []
    for ray in range(len(TANGENTS)):
        image = np.full(SHAPE, 0.7)
        for sheet in sheets:
            covers, sends = (
                FAN.views(each, sheet.z_um)[ray] for each in (sheet.covers, sheet.sends)
            )
            image = image * (1 - covers) + sends
        seen.append(image)
    np.testing.assert_allclose(
        trace(sheets, 0.7, FAN), np.mean(seen, axis=0), atol=1e-6
    )
