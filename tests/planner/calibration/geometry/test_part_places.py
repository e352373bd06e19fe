"""Places of a part at stops of the stage, and which of them tell the scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from microplan.planner.calibration.geometry.drawn_edges import DrawnScale
from microplan.planner.calibration.geometry.part_places import PartPlace, stops_of
from microplan.planner.calibration.readings import PictureReading

SCALE = DrawnScale(stretch=np.eye(2), offset_px=0.1, offset_apart=True, reach_px=50.0)


def places(poor: int) -> list[PartPlace]:
    """Return nine places, two pictures each, some of which tell no scale."""
    found = []
    for number in range(18):
        name, x_um = f"{number}.png", 10.0 * (number // 2)
        place = PartPlace(
            reading=PictureReading(name=name, x_um=x_um), right_px=x_um, up_px=0.0,
            drawn=None if number < poor else SCALE,
        )  # fmt: skip
        found.append(place)
    return found


def test_a_poor_picture_takes_the_scale_from_no_other() -> None:
    stops = stops_of(places(3))
    assert len(stops) == 9
    assert [stop.stretch is None for stop in stops] == [True] + [False] * 8
    assert stops[1].offset_px == 0.1
    assert all(stop.pictures == 2 for stop in stops)


def test_a_few_pictures_that_tell_the_scale_are_not_most() -> None:
    assert all(stop.stretch is None for stop in stops_of(places(9)))
    convex = [replace(p, drawn=replace(SCALE, offset_apart=False)) for p in places(0)]
    assert all(stop.stretch is None for stop in stops_of(convex))
