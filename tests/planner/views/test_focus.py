"""Focus stops: the fewest, proven against trying all and against closed forms."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.planner.assembly.assembly import Place
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.task.workcell import Interval
from microplan.planner.views.focus import (
    HEIGHTS,
    MOST_STOPS,
    NARROWED,
    covered_um,
    fewest_stops,
    focus_for,
    focus_stops,
    narrowed,
)
from microplan.planner.views.views import SEARCH_SIGMAS
from microplan.schemas.pose import Pose
from tests.planner.examples import EXAMPLE, read

FAR = (-1e4, 1e4)
HERE = Span(file="task.yaml", line=1)
intervals = st.tuples(st.integers(0, 30), st.integers(0, 8)).map(
    lambda pair: (float(pair[0]), float(pair[0] + pair[1]))
)


def fewest_by_trying(wanted: Sequence[Interval]) -> int:
    """Return the least number of points that hit every interval, by trying all sets.

    A point may be moved up to the next upper end without losing an interval.
    """
    ends = sorted({high for _, high in wanted})
    for count in range(len(ends) + 1):
        for points in itertools.combinations(ends, count):
            if all(any(a <= p <= b for p in points) for a, b in wanted):
                return count
    raise AssertionError("all upper ends hit everything")


@given(st.lists(intervals, max_size=8), st.sampled_from([0.0, 0.5, 3.0]))
def test_no_smaller_set_of_stops_hits_every_interval(
    wanted: list[Interval], epsilon_um: float
) -> None:
    kept = [narrowed(each, epsilon_um) for each in wanted]
    stops = fewest_stops(kept)
    assert all(any(a <= stop <= b for stop in stops) for a, b in kept)
    assert len(stops) == fewest_by_trying(kept)
    assert list(stops) == sorted(stops)


@given(st.lists(intervals, min_size=1, max_size=8))
def test_a_stop_keeps_off_the_ends_of_what_it_serves(wanted: list[Interval]) -> None:
    wide = [(a, b + 4.0) for a, b in wanted]
    for a, b in wide:
        alone = fewest_stops([narrowed((a, b), 1.0)])
        for stop in fewest_stops([narrowed(each, 1.0) for each in wide]):
            assert not (a <= stop < a + 1.0 and (stop,) == alone)
    assert fewest_stops([(0.0, 10.0)]) == (5.0,)
    assert narrowed((0.0, 2.0), 1.0) == (2.0 * NARROWED, 2.0 * (1 - NARROWED))


def sought_um(sigma_um: float, length_um: float) -> float:
    """Return how far a height is sought: MOST_STOPS halves of what is accepted."""
    return min(SEARCH_SIGMAS * sigma_um, MOST_STOPS * length_um / 4)


@given(
    focus_um=st.floats(-400, 400),
    low_um=st.floats(0.5, 50),
    high_um=st.floats(0.5, 50),
    sigma_um=st.floats(0, 40),
    epsilon_um=st.floats(0, 3),
)
def test_stops_leave_no_gap_in_three_sigma(
    focus_um: float, low_um: float, high_um: float, sigma_um: float, epsilon_um: float
) -> None:
    """However a stop is missed within epsilon, as far as the margin goes."""
    usable = (-low_um, high_um)
    stops = focus_stops(focus_um, [usable], sigma_um, FAR, epsilon_um)
    off = [z - focus_um for z in (focus_um, *stops)]
    reach_um = sought_um(sigma_um, low_um + high_um)
    # the margin first serves the heights between those that were asked for
    room_um = NARROWED * (low_um + high_um) - reach_um / (HEIGHTS - 1)
    missed_um = min(epsilon_um, room_um)
    assert missed_um >= 0
    for height in np.linspace(-reach_um, reach_um, 3 * HEIGHTS):
        gaps = [max(height - low_um - z, z - height - high_um) for z in off]
        assert min(gaps) <= -missed_um + 1e-9
    away = [abs(z) for z in off[1:]]
    assert np.all(np.diff(away) > -1e-5)  # nearest first


@given(low_um=st.floats(1, 50), high_um=st.floats(1, 50), sigma_um=st.floats(0.1, 30))
def test_stops_are_as_few_as_the_lengths_allow(
    low_um: float, high_um: float, sigma_um: float
) -> None:
    """Beyond what the first stop takes in, each further one takes in its length."""
    stops = focus_stops(0.0, [(-low_um, high_um)], sigma_um, FAR)
    length_um = low_um + high_um
    reach_um = sought_um(sigma_um, length_um)
    gap_um = 2 * reach_um / (HEIGHTS - 1)  # heights between are served by a margin
    least = sum(
        math.ceil(round(max(reach_um - end, 0) / length_um, 9))
        for end in (low_um, high_um)
    )
    most = sum(
        math.ceil(max(reach_um - end + gap_um, 0) / (length_um - gap_um) + 1e-9)
        for end in (low_um, high_um)
    )
    assert least <= len(stops) <= most


def test_features_that_accept_different_heights_need_both() -> None:
    """One is sharp from -10 to 2, the other from -2 to 10, within +-24."""
    both = [(-10.0, 2.0), (-2.0, 10.0)]
    stops = focus_stops(100.0, both, 8.0, FAR)
    off = [0.0, *(z - 100 for z in stops)]
    for height in np.linspace(-24, 24, 401):
        for low, high in both:
            assert any(height + low <= z <= height + high for z in off)
    # each way 24 - 2 um are left, and 12 um between stops do for either feature
    assert len(stops) == 2 * math.ceil((24 - 2) / 12)
    # what both accept at once is 4 um wide: one frame for both takes more
    assert len(focus_stops(100.0, [(-2.0, 2.0)], 8.0, FAR)) == 2 * math.ceil(22 / 4)


@given(sigma_um=st.floats(0.1, 30), epsilon_um=st.floats(0, 2))
def test_what_the_stops_cover_is_what_was_asked_for(
    sigma_um: float, epsilon_um: float
) -> None:
    usable = [(-8.0, 13.0), (-20.0, 9.0)]
    stops = focus_stops(0.0, usable, sigma_um, FAR, epsilon_um)
    low, high = covered_um((0.0, *stops), usable, epsilon_um)
    reach_um = SEARCH_SIGMAS * sigma_um
    assert low <= -reach_um + 1e-9
    assert high >= reach_um - 1e-9
    short = covered_um((0.0,), usable, epsilon_um)
    assert short == pytest.approx((-9 + epsilon_um, 8 - epsilon_um))


@given(focus_um=st.floats(-500, 500), sigma_um=st.floats(0, 100))
def test_stops_stay_within_the_drive(focus_um: float, sigma_um: float) -> None:
    stops = focus_stops(focus_um, [(-10.0, 10.0)], sigma_um, (-500.0, 500.0))
    assert all(-500 - 1e-9 <= z <= 500 + 1e-9 for z in stops)
    assert len(set(stops)) == len(stops)


@pytest.mark.parametrize("sigma_um", [1e3, 1e9, 1e300])
def test_a_height_that_nobody_knows_takes_a_bounded_number_of_stops(
    sigma_um: float,
) -> None:
    stops = focus_stops(0.0, [(-1.0, 1.0)], sigma_um, FAR, 0.1)
    assert 0 < len(stops) <= MOST_STOPS
    assert all(math.isfinite(stop) for stop in stops)


def test_a_feature_that_bears_no_focus_error_has_no_further_stop() -> None:
    assert focus_stops(0.0, [(0.0, 0.0), (-9.0, 9.0)], 8.0, FAR, 1.0) == ()
    assert focus_stops(0.0, [], 8.0, FAR) == ()


def test_focus_out_of_reach_is_refused() -> None:
    cell = read(EXAMPLE / "task.yaml").workcell

    def face(z_um: float) -> Place:
        return Place(
            name="gear", owner="gear", carrier="stage", pose=Pose(x_um=0.0, y_um=0.0),
            z_um=z_um, sigma_xy_um=1.0, sigma_theta_rad=0.0,
        )  # fmt: skip

    report = Report()
    assert focus_for(cell, face(500.0), report, HERE) == 500.0
    assert report.found == []
    assert focus_for(cell, face(500.1), report, HERE) is None
    assert [d.code for d in report.found] == ["MP402"]
