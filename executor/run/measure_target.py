"""Measurement of a look's target: view, frame, features, fusion."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.devices.drivers import Counts
from microplan.executor.devices.errors import MACHINE, STOPPED, ExecutorError
from microplan.executor.motion.inverse_kinematics import inverse_kinematics
from microplan.executor.run.measure_feature import Picture, ShownFeature, look_for
from microplan.executor.run.run_context import Rig
from microplan.executor.run.warm_start import FoundFeature, WarmStart
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.routines.fusion import fuse
from microplan.schemas.plan import AxisMove, Look, OnFailure, Requirements

# The least that reflects, a stage of .01 in half of the light, shows brighter; a dark
# frame of the camera does not.
DARK = 0.02
NOT_FOUND = "MP820"
# a look that ends so did not see what it looks for
UNSEEN = (NOT_FOUND, "MP821", "MP822", "MP823", "MP825", "MP826")


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetSighting:
    """Pose at which a look found its target, world frame."""

    target: str
    x_um: float
    y_um: float
    theta_rad: float | None  # None: not measured
    score: float
    spread_um: float  # the best routine's own estimate, one sigma per axis
    sigma_theta_rad: float | None  # by the trials; None: the angle was not measured
    routines: tuple[str, ...]
    frames: int  # grabbed until it was found
    features: Mapping[str, FoundFeature]  # each that was found, by its name


def look_at(
    rig: Rig,
    look: Look,
    on_failure: Sequence[OnFailure] = (),
    *,
    warm_start: WarmStart | None = None,
    trusted: bool = True,
) -> TargetSighting:
    """Measure a look's target and update the beliefs.

    Parameters
    ----------
    rig : Rig
        The running plan.
    look : Look
        What to look at, and how.
    on_failure : sequence of OnFailure
        How often a failure's code, or the routine's own, may be tried again. Every
        try takes the view's next focus stop, and each stop is tried once at least.
        Features that one stop shows and the next does not still count.
    warm_start : WarmStart, optional
        What the same look has found, if a correction is all that happened since: the
        first try starts there.
    trusted : bool, optional
        Whether to look where the target is believed; a probe asks whether that is so.

    Raises
    ------
    ExecutorError
        MP820..MP826 when the tries are used up.
    """
    tries, kept = 0, dict[str, ShownFeature]()
    while True:
        tries += 1
        try:
            first = warm_start if tries == 1 else None
            sighting = _sight(rig, look, tries, kept, first, trusted=trusted)
        except ExecutorError as error:
            rig.journal.write("not_seen", look=look.id, code=error.code, why=str(error))
            further = len(look.view.focus_stops_um)
            trouble = error.exit_status in (MACHINE, STOPPED)  # nothing moves any more
            if trouble or tries > max(_retries(error, on_failure), further):
                if error.code == NOT_FOUND and trusted:
                    error.append(_searched(rig, look))
                raise
            continue
        rig.beliefs.update(
            look.target,
            rig.readings(),
            sighting.x_um,
            sighting.y_um,
            sighting.theta_rad,
            sighting.sigma_theta_rad,
        )
        rig.journal.write("seen", look=look.id, at=sighting)
        rig.keep_beliefs()
        if rig.watch is not None:
            rig.watch(look.target, sighting.x_um, sighting.y_um)
        return sighting


Seeing = Callable[[Rig, Look, Sequence[OnFailure]], TargetSighting]


def look_near(
    rig: Rig,
    looks: Sequence[Look],
    look: Look,
    on_failure: Sequence[OnFailure] = (),
    seeing: Seeing = look_at,
) -> TargetSighting:
    """Measure a look's target, coarsely first and brought near if the plan has it so.

    `seeing` is how each look is made.

    The coarse look's pose is the belief by which the target is centred and expected by
    the fine look. The axes then go back to their readings: what comes after finds them
    where the plan has them.

    Raises
    ------
    ExecutorError
        As `look_at`; MP802 if the plan names a look that the step has not, MP832 if the
        target is too far off to be brought.
    """
    first = look.coarse
    if first is None:
        return seeing(rig, look, on_failure)
    coarse = next((each for each in looks if each.id == first.look), None)
    if coarse is None:
        raise ExecutorError("MP802", f"look {look.id} names no look {first.look!r}")
    seeing(rig, coarse, on_failure)
    readings = rig.readings()
    here = rig.beliefs.world(look.target, readings)
    off_um = math.dist((here.x_um, here.y_um), first.at_um)
    if not off_um <= first.most_um:
        raise ExecutorError(
            "MP832",
            f"look {look.id}: {look.target} is {off_um:.3g} um from where it is to be "
            f"seen, the {first.axes} may bring it {first.most_um:.3g} um",
        )
    back = readings.reading(first.axes)
    rig.move(inverse_kinematics(first.axes, readings, here, first.at_um), "near")
    seen = seeing(rig, look, on_failure)
    rig.move(AxisMove(axes=first.axes, x_um=back.x_um, y_um=back.y_um), "back")
    return seen


def light_of(counts: Counts | FloatArray, need: Requirements) -> FloatArray:
    """Return the light, as a share of full scale, of (rows, columns) counts, float64.

    Below 0 where counts are below those of darkness.
    """
    if not need.response:
        unit: FloatArray = counts / float(2**need.bits - 1)
        return unit
    shares, levels = np.array(need.response).T
    # below darkness as in the first piece, or as on the whole if that is steeper
    slope = max((levels[1] - levels[0]) / shares[1], levels[-1] - levels[0])
    below = np.minimum(counts - levels[0], 0.0) / slope
    light: FloatArray = np.interp(counts, levels, shares) + below
    return light


def _lit(image: FloatArray, need: Requirements) -> str:
    """Return whether a picture in which nothing was found has light in it."""
    most = float(image.max(initial=0.0))
    if most <= light_of(np.zeros(1), need)[0]:
        most = 0.0  # all of it is cut off
    told = f"the brightest pixel of the picture has {most:.1%} of full scale"
    return told + (": is the light on?" if most < DARK else "")


def _searched(rig: Rig, look: Look) -> str:
    """Return where a target was looked for: it may be beyond."""
    at = rig.beliefs.world(look.target, rig.readings())
    return (
        f"it is looked for within {look.measure.capture_um:.3g} um of "
        f"({at.x_um:.1f}, {at.y_um:.1f}) um, where it is believed"
    )


def _retries(error: ExecutorError, on_failure: Sequence[OnFailure]) -> int:
    """Return how often this failure may be tried again."""
    codes = (error.code, error.cause)
    return max(
        (f.times for f in on_failure if f.do == "retry" and f.code in codes), default=0
    )


def _sight(
    rig: Rig,
    look: Look,
    tries: int,
    kept: dict[str, ShownFeature],
    warm_start: WarmStart | None,
    *,
    trusted: bool,
) -> TargetSighting:
    """Look once at every feature of the look; `kept` are those of tries before.

    Features that disagree are forgotten: one of them is wrong.
    """
    rig.journal.write("look", look=look.id, target=look.target)
    stops = (look.view.focus_um, *look.view.focus_stops_um)
    focus_um = stops[(tries - 1) % len(stops)]
    rig.set_view(look.view, focus_um=focus_um)
    look = rig.placed(look)
    counts = rig.grab(look.measure.region, look=look.id)
    readings = rig.readings()
    picture = Picture(
        image=light_of(counts, rig.plan.requirements),
        frame=rig.frame_of(look),
        expected=rig.beliefs.world(look.target, readings),
        believed=rig.beliefs.angle(look.target, readings),
        warm_start=warm_start,
        trusted=trusted,
    )
    try:
        _show(rig, look, picture, kept)
    except ExecutorError as error:
        if error.code == NOT_FOUND:
            error.append(_lit(picture.image, rig.plan.requirements))
        raise
    try:
        names = [measure.feature or look.target for measure in look.measures]
        found = {name: kept[name] for name in names if name in kept}
        return _fused(look, found, picture, tries)
    except ExecutorError:
        kept.clear()
        raise


def _show(
    rig: Rig, look: Look, picture: Picture, kept: dict[str, ShownFeature]
) -> None:
    """Add the features that a picture shows; raise if too few are known even so."""
    least = len(look.measures) if look.together is None else look.together.least
    faults: list[ExecutorError] = []
    for measure in look.measures:
        name = measure.feature or look.target
        try:
            kept[name] = look_for(rig, look, measure, picture)
        except ExecutorError as error:
            faults.append(error)
            if look.others:
                why = str(error)
                rig.journal.write("missed", look=look.id, code=error.code, why=why)
    if faults and len(kept) < max(least, 1):
        raise faults[0]


def _fused(
    look: Look, found: Mapping[str, ShownFeature], picture: Picture, tries: int
) -> TargetSighting:
    """Return the target's pose by all features found."""
    shown = tuple(found.values())
    pose = fuse([each.seen for each in shown], picture.believed)
    if isinstance(pose, Failure):
        raise ExecutorError(
            "MP826",
            f"look {look.id}: {look.target}: {pose.message}",
            cause=pose.code,
        )
    return TargetSighting(
        target=look.target,
        x_um=pose.x_um,
        y_um=pose.y_um,
        theta_rad=pose.theta_rad,
        score=min(each.score for each in shown),
        spread_um=min(each.spread_um for each in shown),
        sigma_theta_rad=pose.sigma_theta_rad,
        routines=tuple(name for each in shown for name in each.routines),
        frames=tries,
        features={name: each.found for name, each in found.items()},
    )
