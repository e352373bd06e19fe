"""Packed grids of distances: what loops over rays read is each body's own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from microplan.arrays import Float32Array
from microplan.optics.layers.solids import packed_bodies
from microplan.optics.layers.solids.packed_bodies import packed
from microplan.optics.layers.solids.straight_rays import ThickBody
from microplan.optics.outline.distance_field import distance_field
from tests.optics.shapes import disc

AREA = (-40.0, -40.0, 40.0, 40.0)


def body(radius_um: float) -> ThickBody:
    """Return a post."""
    distance = distance_field(disc(radius_um), AREA)
    assert distance is not None
    return ThickBody(distance=distance, top_um=50.0, under_um=0.0, wall_reflectance=0.5)


def check(bodies: Sequence[ThickBody]) -> tuple[Float32Array, list[int]]:
    """Check that each body's numbers lead to its own grid; return all, and starts."""
    grids, numbers = packed(bodies)
    for row, each in zip(numbers, bodies, strict=True):
        first, values = int(row[0]), each.distance.values
        assert (int(row[2]), int(row[1])) == values.shape
        own = grids[first : first + values.size]
        np.testing.assert_array_equal(own, values.ravel())
    return grids, numbers[:, 0].astype(int).tolist()


@pytest.fixture(autouse=True)
def pool(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packed_bodies, "_POOL", packed_bodies._Pool())


def test_grids_stay_where_they_are_while_there_is_room() -> None:
    one, other, third = body(11.0), body(12.0), body(13.0)
    _, (first, second) = check([one, other])
    assert check([other, third, one])[1][::2] == [second, first]
    grids, _ = check([third, third])
    assert grids.size == sum(b.distance.values.size for b in (one, other, third))


def test_where_room_ends_earlier_arrays_are_unchanged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bodies = [body(14.0 + k) for k in range(6)]
    room = 2.5 * bodies[0].distance.values.nbytes
    monkeypatch.setattr(packed_bodies, "_POOL_BYTES", int(room))
    held = [check([each])[0] for each in bodies]
    assert max(grids.nbytes for grids in held) <= room
    before = [grids.copy() for grids in held]
    check(bodies)  # more than there is room for
    for now, then in zip(held, before, strict=True):
        np.testing.assert_array_equal(now, then)
