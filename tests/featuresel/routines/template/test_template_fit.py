"""The fit of a template, where rendered parts are too small to show it."""

from __future__ import annotations

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.template.template_fit import TemplateFit, refine


def texture(rows: int, columns: int, column: float, row: float) -> FloatArray:
    """Return waves that have edges everywhere, with their middle at (column, row)."""
    y, x = np.mgrid[:rows, :columns].astype(float)
    x, y = x - column, y - row
    waves = np.sin(0.31 * x + 0.07 * y) + np.sin(0.05 * x - 0.29 * y)
    return np.asarray(0.5 + 0.2 * waves)


def test_a_template_may_have_more_pixels_than_a_short_integer_counts() -> None:
    template = texture(257, 257, 128.0, 128.0)
    assert template.size > 2 * np.iinfo(np.int16).max
    image = texture(300, 320, 161.3, 149.6)
    start = (160.0, 150.0, 0.0)
    found = refine(image, template, start, 1, least_score=0.9, scale_off=0.03)
    assert isinstance(found, TemplateFit)
    # the cubic between samples errs by (0.31 px)**4 / 100 of the waves or so
    np.testing.assert_allclose((found.column, found.row), (161.3, 149.6), atol=0.01)
    np.testing.assert_allclose(found.turned_rad, 0.0, atol=1e-4)
