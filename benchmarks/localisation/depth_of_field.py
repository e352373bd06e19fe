"""Depth of field by a task's tolerance, with what each unknown of the light costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from benchmarks.localisation.information import only
from microplan.featuresel.limits.crlb import camera_of, fisher
from microplan.featuresel.limits.information import Information, limit
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.sensitivity import LookSetting, sensitivities

Curve = Callable[[float], float]

_GROWTH = 1.5  # of the steps outward from focus
_BISECTIONS = 6  # of the last step: to 1/64 of it


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthOfField:
    """Focus heights at which a task's tolerance is met; both 0 if not even at first."""

    lowest_um: float  # of the focus from nominal, <= 0
    highest_um: float
    textbook_um: float  # n wavelength / A**2, from end to end

    @property
    def depth_um(self) -> float:
        """Return how far the focus may go from end to end."""
        return self.highest_um - self.lowest_um


def limit_curve(case: LookCase, name: str, names: Sequence[str]) -> Curve:
    """Return the limit of one parameter as a function of the focus from nominal.

    Parameters
    ----------
    case : LookCase
        The look.
    name : str
        Whose limit, one of `names`.
    names : sequence of str
        All that is unknown, see `microplan.featuresel.look.sensitivity`.
    """
    camera = camera_of(case)

    def sigma(dz_um: float) -> float:
        seen = sensitivities(case, LookSetting(dz_um=dz_um), names)
        return limit(fisher(seen, camera))[name]

    return sigma


def depth_of_field(
    case: LookCase, sigma: Curve, tolerance: float, *, reach_um: float
) -> DepthOfField:
    """Return over which focus heights a standard deviation stays within a tolerance.

    Parameters
    ----------
    case : LookCase
        The look, for the textbook's depth and the first step, a quarter of it.
    sigma : callable
        Standard deviation at a focus from nominal, um; `limit_curve`, or a routine's.
    tolerance : float
        For it, > 0, in its unit.
    reach_um : float
        Where to stop looking, > 0.

    Returns
    -------
    DepthOfField
        Around the nominal focus. Each end is searched outward in steps that grow by
        half, and the last step halved six times; a gap between two steps is not seen.

    Raises
    ------
    ValueError
        If the tolerance or the reach is not positive.
    """
    if not (tolerance > 0 and reach_um > 0):
        raise ValueError(
            f"tolerance and reach_um must be positive, got {tolerance}, {reach_um}"
        )
    textbook = case.microscope.wave_depth_um
    first = min(textbook / 4, reach_um)
    ends = [0.0, 0.0]
    if sigma(0.0) <= tolerance:
        below = _end(lambda z: sigma(-z) <= tolerance, first, reach_um)
        above = _end(lambda z: sigma(z) <= tolerance, first, reach_um)
        ends = [-below, above]
    return DepthOfField(lowest_um=ends[0], highest_um=ends[1], textbook_um=textbook)


def _end(meets: Callable[[float], bool], step_um: float, reach_um: float) -> float:
    """Return how far outward from 0 a tolerance is met."""
    good, bad = 0.0, step_um
    while meets(bad):
        if bad >= reach_um:
            return reach_um
        good, step_um = bad, step_um * _GROWTH
        bad = min(bad + step_um, reach_um)
    for _ in range(_BISECTIONS):
        middle = (good + bad) / 2
        good, bad = (middle, bad) if meets(middle) else (good, middle)
    return good


def prices(
    information: Information,
    wanted: Collection[str],
    *,
    free: Collection[str] = (),
    extra: Collection[str],
) -> dict[str, float]:
    """Return how many times larger one more unknown makes the limits.

    Parameters
    ----------
    information : Information
        About all names below.
    wanted : collection of str
        What is to be found.
    free : collection of str
        What is unknown anyway.
    extra : collection of str
        What could be unknown too; each alone is added.

    Returns
    -------
    dict of str to float
        Of each `extra` the largest ratio of limits over what is wanted and observable,
        at least 1; inf if it makes one of them unobservable, 1 if none is observable.

    Raises
    ------
    KeyError
        If a name is missing.
    """
    without = limit(only(information, {*wanted, *free}))
    cost = {}
    for name in extra:
        given = limit(only(information, {*wanted, *free, name}))
        ratios = [given[w] / without[w] for w in wanted if without[w] < math.inf]
        cost[name] = max([1.0, *ratios])
    return cost
