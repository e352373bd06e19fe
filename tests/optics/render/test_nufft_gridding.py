"""The kernel read from polynomials against the kernel itself."""

import numpy as np

from microplan.optics.render.nufft_gridding import kernel, kernel_weights


def test_kernel_by_polynomials_is_the_kernel() -> None:
    place = np.linspace(0.0, 1.0, 997)  # of a period of 40 grid points
    grid, found = kernel_weights(place, 40)
    away = (grid - place[:, None] * 40 + 20) % 40 - 20  # the nearest repetition
    # 15 Chebyshev terms leave 4e-15, and `away` is rounded to 40 epsilon
    np.testing.assert_allclose(found, kernel(away), rtol=0, atol=2e-13)
