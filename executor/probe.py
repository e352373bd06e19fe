"""A probe: small known moves that show whether the image follows the axes.

Made at the first look after every zoom change, before any motion that depends on it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from executor.calibration import IDENTITY
from executor.errors import MACHINE, STOPPED, ExecutorError
from executor.following import Followed, check_directions, check_scale, followed
from executor.look import Sighting, look_at
from executor.rig import Rig
from executor.safety import check_step, check_travel, targets
from executor.verify import in_view
from schemas.plan import AlignAction, AxesName, AxisMove, Look, OnFailure

Point = tuple[float, float]

LEAST_UM = 3.0  # a first move: what any stage can do and any eye can see
WANTED = 10.0  # sigmas of a first move's own scatter: what it is to be
ENOUGH = 5.0  # what it must be: a wrong direction is then told from a right one
REACH = 0.7  # of the look's capture range: trials succeed there as they do inside
MOST_UM = 100.0  # beyond, lens distortion and lean of the axes come in
DECIMALS = 1  # of the places that a probe goes to, um
CLEAR = 3.0  # sigmas that a probe stays away from everything
# A tolerance below .6 move sigmas is refused by the compiler.
TOLERANCE_PER_SIGMA = 0.6


@dataclass(slots=True)
class Track:
    """Readings of the axes and where the target was seen, (x, y) um each."""

    readings: list[Point] = field(default_factory=list)
    places: list[Point] = field(default_factory=list)


def look_probed(rig: Rig, look: Look, on_failure: Sequence[OnFailure] = ()) -> Sighting:
    """Look, and probe if nothing was probed at this zoom yet; then look again.

    Raises
    ------
    ExecutorError
        As `look_at`; MP833 if the image goes another way than the axes, MP834 if it is
        out of scale, MP835 if the target is lost by the first moves.
    """
    seen = look_at(rig, look, on_failure)
    if rig.probed == look.view.magnification:
        return seen
    why = probe(rig, look, seen, on_failure)
    if why:
        rig.journal.write("probe_skipped", look=look.id, why=why)
        return seen
    rig.probed = look.view.magnification
    return look_at(rig, look, on_failure)


def probe(
    rig: Rig, look: Look, seen: Sighting, on_failure: Sequence[OnFailure] = ()
) -> str:
    """Move what carries the target in x and y, look after each, and go back.

    Two short moves tell the directions. Then four places around the look's own, as far
    as it is sure to find the target, tell the scale.

    Returns
    -------
    str
        Why nothing was moved; "" if the probe was made and the image is right.

    Raises
    ------
    ExecutorError
        See `look_probed`.
    """
    axes = rig.beliefs.belief(look.target).carrier
    sigma_um = math.hypot(axis_sigma_um(rig, axes), look.sigma_xy_um)
    reach_um = min(REACH * min(m.capture_um for m in look.measures), MOST_UM)
    step_um = min(max(LEAST_UM, WANTED * math.sqrt(2) * sigma_um), reach_um)
    if step_um < ENOUGH * math.sqrt(2) * sigma_um:
        return f"a move of {step_um:.3g} um does not stand out of {sigma_um:.3g} um"
    home = rig.readings().reading(axes)
    at = (home.x_um, home.y_um)
    middle = look.measure.reference.pose
    # rounded, so that the noise of a look does not change what is ordered
    inward = (
        round(middle.x_um - seen.x_um, DECIMALS),
        round(middle.y_um - seen.y_um, DECIMALS),
    )
    first = (at[0] + _toward(inward[0], step_um), at[1])
    second = (first[0], at[1] + _toward(inward[1], step_um))
    for place in (first, second):
        why = in_the_way(rig, look, axes, place)
        if why:
            return why
    track = Track([at], [(seen.x_um, seen.y_um)])
    for place in (first, second):
        _step(rig, look, axes, place, track, on_failure)
    check_directions(_followed(rig, axes, track, sigma_um), look)
    for place in _around((at[0] + inward[0], at[1] + inward[1]), reach_um):
        if in_the_way(rig, look, axes, place):
            continue
        try:
            _step(rig, look, axes, place, track, on_failure)
        except ExecutorError as error:
            if error.code != "MP835":
                raise
            rig.journal.write("probe_unseen", look=look.id, why=str(error))
    found = _followed(rig, axes, track, sigma_um)
    rig.journal.write(
        "probe",
        look=look.id,
        axes=axes,
        matrix=found.matrix.ravel().tolist(),
        sigma=found.sigma.ravel().tolist(),
        looks=len(track.places),
    )
    check_directions(found, look)
    check_scale(found, look)
    rig.move(AxisMove(axes=axes, x_um=at[0], y_um=at[1]))
    return ""


def axis_sigma_um(rig: Rig, axes: AxesName) -> float:
    """Return one sigma per axis of where an axis group lands.

    As the plan tells; else the most that its alignments' tolerances allow.
    """
    told = rig.plan.requirements.repeatability_um
    if told is not None and axes in told:
        return told[axes]
    tolerances = [
        step.control.tolerance_xy_um
        for step in rig.plan.steps
        if isinstance(step.action, AlignAction)
        and step.action.axes == axes
        and step.control is not None
    ]
    return min(tolerances, default=0.0) / TOLERANCE_PER_SIGMA


def in_the_way(rig: Rig, look: Look, axes: AxesName, place: Point) -> str:
    """Return what forbids a probe's move to a reading, "" if nothing does.

    Besides limits and steps a probe stays clear of everything by CLEAR sigmas, also of
    what it is meant to touch later. Where the plan tells no room, nothing may be held
    and the tool must be out of view.
    """
    move = AxisMove(axes=axes, x_um=place[0], y_um=place[1])
    try:
        check_travel(axes, targets(move), rig.station.offer.travel)
        limit = rig.station.rules.safety.phase(rig.phase)
        check_step(move, rig.readings().reading(axes), rig.phase, limit)
    except ExecutorError as error:
        return error.message
    if not rig.keep_out.known:
        return _near_tool(rig, look)
    spread_um = max(belief.sigma_xy_um for belief in rig.plan.beliefs)
    margin_um = CLEAR * math.hypot(spread_um, axis_sigma_um(rig, axes))
    met = rig.keep_out.met(move, rig.moment(), margin_um=margin_um)
    if met is None:
        return ""
    return f"{met[0]} would come nearer than {margin_um:.3g} um to {met[1]}"


def _followed(rig: Rig, axes: AxesName, track: Track, sigma_um: float) -> Followed:
    """Return how the image followed, the calibration's own matrix taken off."""
    calibration = rig.station.offer.calibration
    meant = IDENTITY
    if axes == "stage" and calibration is not None:
        meant = calibration.camera_from_stage
    found = followed(track.readings, track.places, sigma_um)
    return replace(found, matrix=found.matrix @ np.linalg.inv(np.array(meant)))


def _step(
    rig: Rig,
    look: Look,
    axes: AxesName,
    place: Point,
    track: Track,
    on_failure: Sequence[OnFailure],
) -> None:
    """Move, look and note; MP835 if the target is not seen there."""
    rig.move(AxisMove(axes=axes, x_um=place[0], y_um=place[1]))
    try:
        seen = look_at(rig, look, on_failure)
    except ExecutorError as error:
        if error.exit_status in (MACHINE, STOPPED):
            raise
        raise ExecutorError(
            "MP835",
            f"look {look.id}: {look.target} was lost after a probe's move of the "
            f"{axes} to ({place[0]:.6g}, {place[1]:.6g}) um: {error} [{error.code}]",
            cause=error.cause,
        ) from error
    track.readings.append(place)
    track.places.append((seen.x_um, seen.y_um))


def _toward(way_um: float, step_um: float) -> float:
    """Return a step with the sign of a way; up where there is none to go."""
    return -step_um if way_um < 0 else step_um


def _around(middle: Point, reach_um: float) -> Iterator[Point]:
    """Yield four places about a middle, each axis from end to end."""
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        yield middle[0] + dx * reach_um, middle[1] + dy * reach_um


def _near_tool(rig: Rig, look: Look) -> str:
    """Return whether a tool holds something or is in view; "" if neither."""
    for belief in rig.plan.beliefs:
        if rig.station.robot is None or belief.carrier != "robot":
            continue
        grip = rig.beliefs.world(belief.name, rig.readings())
        held = rig.beliefs.held_by(belief.name)
        if held or in_view(grip, look.view.field_um):
            return f"{belief.name} is near"
    return ""
