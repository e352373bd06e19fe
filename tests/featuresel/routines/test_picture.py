"""What is an image and what is not."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.featuresel.routines.picture import refused

IMAGE = np.linspace(0.0, 1.0, 20).reshape(4, 5)


@pytest.mark.parametrize("image", [IMAGE, 1.1 * IMAGE - 0.05, IMAGE[:1, :1], -IMAGE])
def test_an_image_may_leave_its_range_a_little(image: np.ndarray) -> None:
    assert refused(image) is None


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1.8e308, 1001.0, -1001.0])
@pytest.mark.parametrize("at", [(0, 0), (3, 4), (2, 2)])
def test_a_single_pixel_that_is_no_light_is_refused(
    value: float, at: tuple[int, int]
) -> None:
    image = IMAGE.copy()
    image[at] = value
    found = refused(image)
    assert found is not None
    assert found.code == "no_image"
    assert f"{value:.3g}" in found.message


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (5, 0), (7,), (2, 2, 3)])
def test_what_is_no_table_of_pixels_is_refused(shape: tuple[int, ...]) -> None:
    found = refused(np.zeros(shape))
    assert found is not None
    assert str(shape) in found.message
