"""Focus heights: the fewest that serve the focus ranges of all features."""

from __future__ import annotations

from collections.abc import Sequence

from microplan.optics.outline.tolerant_order import above, at_most
from microplan.planner.assembly.assembly import Place, State, height_sigma_um
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import Interval, Workcell
from microplan.planner.views.views import SEARCH_SIGMAS

MOST_STOPS = 40  # of one look: farther off, a target is not searched for by focus
HEIGHTS = 101  # at which an uncertain height is taken to lie, over SEARCH_SIGMAS
NARROWED = 0.25  # of what is accepted, at most, is kept from each of its ends


def focus_for(
    cell: Workcell, place: Place, report: Report, where: Span
) -> float | None:
    """Return the height to focus on, the target's face; report one out of reach."""
    focus = cell.optics.focus
    if focus.min_um <= place.z_um <= focus.max_um:
        return place.z_um
    report.refuse(
        "MP402",
        where,
        f"the face of {place.name} is {place.z_um:g} um high, the focus reaches "
        f"{focus.min_um:g} to {focus.max_um:g} um",
        "bring it to another height, or widen optics.focus in the workcell",
    )
    return None


def fewest_stops(intervals: Sequence[Interval]) -> tuple[float, ...]:
    """Return the smallest set of heights that hits every interval, lowest first.

    Parameters
    ----------
    intervals : sequence of (low, high)
        Heights that one feature accepts, low <= high.

    Returns
    -------
    tuple of float
        Of the intervals not hit yet, the one that ends first needs a stop, and no stop
        in it serves any other that its end does not: none is wasted. The stop goes into
        the middle of what all that it serves share. Empty without intervals.
    """
    left = sorted(intervals, key=_end)
    stops = []
    while left:
        end = left[0][1]
        served = [low for low, _ in left if at_most(low, end, scale=1.0)]
        stops.append((max(served) + end) / 2)
        left = [each for each in left if above(each[0], end, scale=1.0)]
    return tuple(stops)


def narrowed(interval: Interval, epsilon_um: float) -> Interval:
    """Return an interval without its ends: epsilon each, at most NARROWED of it."""
    low, high = interval
    room = min(epsilon_um, NARROWED * (high - low))
    return (low + room, high - room)


def focus_stops(
    focus_um: float,
    usable_um: Sequence[Interval],
    sigma_um: float,
    limits_um: Interval,
    epsilon_um: float = 0.0,
) -> tuple[float, ...]:
    """Return further heights to focus on where the target's own height is uncertain.

    Parameters
    ----------
    focus_um : float
        The first height tried.
    usable_um : sequence of (low, high)
        For each feature, the focus errors at which it is still measured, low <= 0 <=
        high. Features may be found at different stops.
    sigma_um : float
        Of the target's height.
    limits_um : (low, high)
        What the focus drive reaches.
    epsilon_um : float
        By how much a stop may be missed.

    Returns
    -------
    tuple of float
        Nearest first, at most MOST_STOPS; with `focus_um` the fewest that hit what
        every feature accepts, wherever in SEARCH_SIGMAS the height is. Empty if
        `focus_um` does.
    """
    if min((high - low for low, high in usable_um), default=0.0) <= 0:
        return ()
    heights, margin_um = _heights(usable_um, sigma_um, epsilon_um)
    needed = [
        narrowed((height + low, height + high), margin_um)
        for height in heights
        for low, high in usable_um
    ]
    low_um, high_um = limits_um[0] - focus_um, limits_um[1] - focus_um
    reached = [
        (max(low, low_um), min(high, high_um))
        for low, high in needed
        if low <= high_um and high >= low_um and not low <= 0 <= high
    ]
    stops = sorted(fewest_stops(reached), key=lambda d: (round(abs(d), 6), -d))
    return tuple(focus_um + d for d in stops[:MOST_STOPS])


def look_stops(
    task: Task, state: State, owner: str, focus_um: float, usable_um: Sequence[Interval]
) -> tuple[float, ...]:
    """Return further heights to focus on for a look at what belongs to `owner`."""
    focus = task.workcell.optics.focus
    return focus_stops(
        focus_um,
        usable_um,
        height_sigma_um(task, state, owner),
        (focus.min_um, focus.max_um),
        reach_margin_um(task.workcell),
    )


def covered_um(
    stops_um: Sequence[float], usable_um: Sequence[Interval], epsilon_um: float
) -> Interval:
    """Return the errors of a height that stops take in for every feature, without gap.

    `stops_um` are from the target's nominal height, 0 among them; a stop that is off by
    epsilon to either side still does.
    """
    ends = []
    for usable in usable_um:
        low, high = narrowed(usable, epsilon_um)
        spans = sorted((stop - high, stop - low) for stop in stops_um)
        first = last = 0.0
        for start, end in spans:
            if start <= last:
                last = max(last, end)
        for start, end in sorted(spans, key=_end, reverse=True):
            if end >= first:
                first = min(first, start)
        ends.append((first, last))
    return (max(e[0] for e in ends), min(e[1] for e in ends))


def reach_margin_um(cell: Workcell) -> float:
    """Return by how much the focus drive may miss a stop."""
    return SEARCH_SIGMAS * cell.optics.focus.repeatability_um


def _heights(
    usable_um: Sequence[Interval], sigma_um: float, epsilon_um: float
) -> tuple[list[float], float]:
    """Return errors of the height to serve, and the margin that serves those between.

    Farther off than MOST_STOPS could serve, nothing is asked for.
    """
    least = min(high - low for low, high in usable_um)
    reach = min(SEARCH_SIGMAS * sigma_um, MOST_STOPS * least * (1 - 2 * NARROWED) / 2)
    gap = 2 * reach / (HEIGHTS - 1)
    middle = (HEIGHTS - 1) / 2
    return [(k - middle) * gap for k in range(HEIGHTS)], epsilon_um + gap / 2


def _end(interval: Interval) -> float:
    return interval[1]
