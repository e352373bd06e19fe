"""Tables of profiles: apertures of any lens, and where they end."""

from __future__ import annotations

import numpy as np
import pytest

from microplan.planner.calibration.through_focus.profile_table import (
    ProfileTable,
    columns,
)


@pytest.mark.parametrize("index", [1.0, 1.33, 1.515])
@pytest.mark.parametrize("share", [0.05, 0.42, 0.76, 0.85, 0.9, 0.95, 0.99])
def test_columns_rise_about_every_aperture_of_a_lens(
    share: float, index: float
) -> None:
    found = columns(share * index, index)
    assert len(found) >= 4
    assert (np.diff(found) > 0.02 * found[:-1]).all()
    assert found[-1] < index
    assert found[0] < 0.75 * share * index
    table = ProfileTable.of(np.linspace(0, 9, 7), found, np.ones((7, len(found), 5)))
    np.testing.assert_allclose(table(-1.0, 0.9 * share * index), 1.0)
    assert table.middle == pytest.approx(share * index)
    assert table.holds(8.0, 0.99 * share * index)
    for off in (0.9 * share * index, *table.ends):
        assert table.holds(8.0, off) == (abs(off / table.middle - 1) < 0.02)
    assert not table.holds(9.0, share * index)
