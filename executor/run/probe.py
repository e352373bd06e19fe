"""Probes: small known moves that measure how the image follows the axes.

Made at the first look after every zoom change, before any motion that depends on it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from microplan.arrays import Point
from microplan.executor.devices.calibration import IDENTITY
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import check_step, check_travel, targets
from microplan.executor.motion.inverse_kinematics import inverse_kinematics
from microplan.executor.run.image_jacobian import (
    ImageJacobian,
    check_directions,
    check_scale,
    check_turn,
    fit_jacobian,
)
from microplan.executor.run.measure_target import UNSEEN, TargetSighting, look_at
from microplan.executor.run.run_context import Rig
from microplan.executor.run.verify import in_view
from microplan.executor.run.warm_start import WarmStart
from microplan.schemas.plan import (
    AlignAction,
    AxesName,
    AxisMove,
    Control,
    Look,
    OnFailure,
)

CLEAR = 3.0  # sigmas that a probe stays away from everything
# A tolerance below .6 move sigmas is refused by the compiler.
TOLERANCE_PER_SIGMA = 0.6


def steers_angle(rig: Rig, axes: AxesName) -> bool:
    """Return whether an alignment of the plan corrects an angle by these axes."""
    return any(c.tolerance_theta_rad is not None for c in _controls(rig, axes))


def _controls(rig: Rig, axes: AxesName) -> list[Control]:
    """Return the controls of the plan's alignments by these axes."""
    return [
        step.control
        for step in rig.plan.steps
        if isinstance(step.action, AlignAction)
        and step.action.axes == axes
        and step.control is not None
    ]


def axis_sigma_um(rig: Rig, axes: AxesName) -> float:
    """Return one sigma per axis of where an axis group lands.

    As the plan states; else the most that its alignments' tolerances allow.
    """
    told = rig.plan.requirements.repeatability_um
    if told is not None and axes in told:
        return told[axes]
    tolerances = [control.tolerance_xy_um for control in _controls(rig, axes)]
    return min(tolerances, default=0.0) / TOLERANCE_PER_SIGMA


def in_the_way(rig: Rig, look: Look, move: AxisMove) -> str:
    """Return the obstacle to a probe's move in words, "" if there is none.

    Besides limits and steps a probe stays clear of everything by CLEAR sigmas, also of
    what it is meant to touch later. Where the plan has no volumes, nothing may be held
    and the tool must be out of view.
    """
    axes = move.axes
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


LEAST_UM = 3.0  # a first move: what any stage can do and any eye can see
WANTED = 10.0  # sigmas of a first move's own scatter: what it is to be
ENOUGH = 5.0  # what it must be: a wrong direction is then distinct from a right one
REACH = 0.7  # of the look's capture range: trials succeed there as they do inside
MOST_UM = 100.0  # beyond, lens distortion and lean of the axes come in
LEAST_RAD = math.radians(1.0)  # of a rotation, as LEAST_UM
MOST_RAD = math.radians(8.0)  # less than half a tooth of 20 deg
DECIMALS = 1  # of the positions that a probe goes to, um


@dataclass(frozen=True, slots=True, kw_only=True)
class _ProbeState:
    """State of a probe: its look, its axes, its sightings."""

    rig: Rig
    look: Look
    axes: AxesName  # that carry the look's target
    sigma_um: float  # of a position per axis, the axes' landing included
    on_failure: tuple[OnFailure, ...]
    readings: list[Point] = field(default_factory=list)  # of the axes, (x, y) um
    positions: list[Point] = field(default_factory=list)  # where the target was seen

    def note(self, reading: Point, seen: TargetSighting) -> None:
        """Add a reading and where the target was seen."""
        self.readings.append(reading)
        self.positions.append((seen.x_um, seen.y_um))


def look_probed(
    rig: Rig,
    look: Look,
    on_failure: Sequence[OnFailure] = (),
    *,
    warm_start: WarmStart | None = None,
) -> TargetSighting:
    """Look, and probe if nothing was probed at this zoom yet; then look again.

    `warm_start` is as in `look_at`.

    Raises
    ------
    ExecutorError
        As `look_at`; MP833 if the image does not go as the axes, MP834 if it is
        out of scale, MP835 if the target is lost by the first moves.
    """
    seen = look_at(rig, look, on_failure, warm_start=warm_start)
    if rig.probed == look.view.magnification:
        return seen
    why = probe(rig, look, seen, on_failure)
    if why:
        rig.journal.write("probe_skipped", look=look.id, why=why)
        return seen
    rig.probed = look.view.magnification
    return look_at(rig, look, on_failure)


def probe(
    rig: Rig, look: Look, seen: TargetSighting, on_failure: Sequence[OnFailure] = ()
) -> str:
    """Move what carries the target in x and y, look after each, and go back.

    Two short moves show the directions. Then four positions around the look's own,
    as far as it is sure to find the target, show the scale.

    Returns
    -------
    str
        Why nothing was moved; "" if the probe was made and the image is right.

    Raises
    ------
    ExecutorError
        See `look_probed`.
    """
    look = rig.placed(look)  # what the moves do must not move the region
    axes = rig.beliefs.belief(look.target).carrier
    landing_um = math.hypot(axis_sigma_um(rig, axes), look.sigma_xy_um)
    job = _ProbeState(
        rig=rig, look=look, axes=axes, sigma_um=landing_um, on_failure=tuple(on_failure)
    )
    sigma_um = math.sqrt(2) * job.sigma_um  # of a move, by its two ends
    reach_um = min(REACH * min(m.capture_um for m in look.measures), MOST_UM)
    step_um = min(max(LEAST_UM, WANTED * sigma_um), reach_um)
    if step_um < ENOUGH * sigma_um:
        return f"a move of {step_um:.3g} um does not stand out of {sigma_um:.3g} um"
    home = rig.readings().reading(job.axes)
    x_um, y_um = home.x_um, home.y_um
    inward_x, inward_y = _inward(look, seen)
    first = (x_um + _toward(inward_x, step_um), y_um)
    second = (first[0], y_um + _toward(inward_y, step_um))
    for position in (first, second):
        why = in_the_way(rig, look, _to(job.axes, position))
        if why:
            return why
    job.note((x_um, y_um), seen)
    for position in (first, second):
        _step(job, position)
    check_directions(_measured_jacobian(job), look)
    _reach_out(job, (x_um + inward_x, y_um + inward_y), reach_um)
    _judge(job)
    rig.move(_to(job.axes, (x_um, y_um)), "probe back")
    if seen.theta_rad is not None and steers_angle(rig, job.axes):
        _probe_turn(job, seen.theta_rad)
    return ""


def _inward(look: Look, seen: TargetSighting) -> Point:
    """Return the vector from a target to the middle of its look's range, um.

    Rounded, so that the noise of a look does not change what is ordered.
    """
    middle = look.measure.reference.pose
    return (
        round(middle.x_um - seen.x_um, DECIMALS),
        round(middle.y_um - seen.y_um, DECIMALS),
    )


def _step(job: _ProbeState, position: Point) -> None:
    """Move, look and note; MP835 if the target is not seen there."""
    job.note(position, _moved(job, _to(job.axes, position)))


def _reach_out(job: _ProbeState, middle: Point, reach_um: float) -> None:
    """Look from four positions about a middle, those without a collision."""
    for position in _around(middle, reach_um):
        if in_the_way(job.rig, job.look, _to(job.axes, position)):
            continue
        try:
            _step(job, position)
        except ExecutorError as error:
            if error.code != "MP835":
                raise
            why = str(error)
            job.rig.journal.write("probe_unseen", look=job.look.id, why=why)


def _judge(job: _ProbeState) -> None:
    """Note how the image followed, and raise if it did not."""
    found = _measured_jacobian(job)
    job.rig.journal.write(
        "probe",
        look=job.look.id,
        axes=job.axes,
        matrix=found.matrix.ravel().tolist(),
        sigma=found.sigma.ravel().tolist(),
        looks=len(job.positions),
    )
    check_directions(found, job.look)
    check_scale(found, job.look)


def _measured_jacobian(job: _ProbeState) -> ImageJacobian:
    """Return how the image followed, the calibration's own matrix taken off."""
    calibration = job.rig.station.offer.calibration
    meant = IDENTITY
    if job.axes == "stage" and calibration is not None:
        meant = calibration.camera_from_stage
    found = fit_jacobian(job.readings, job.positions, job.sigma_um)
    return replace(found, matrix=found.matrix @ np.linalg.inv(np.array(meant)))


def _moved(job: _ProbeState, move: AxisMove) -> TargetSighting:
    """Move and look; MP835 if the target is not seen there."""
    rig, look = job.rig, job.look
    rig.move(move, "probe")
    try:
        return look_at(rig, look, job.on_failure, trusted=False)
    except ExecutorError as error:
        if error.code not in UNSEEN:
            raise
        raise ExecutorError(
            "MP835",
            f"look {look.id}: {look.target} was lost after a probe's move of the "
            f"{move.axes} to ({move.x_um:.6g}, {move.y_um:.6g}) um: {error} "
            f"[{error.code}]",
            cause=error.cause,
        ) from error


def _probe_turn(job: _ProbeState, theta_rad: float) -> None:
    """Rotate a little about the target, look, and rotate back."""
    rig, look, axes = job.rig, job.look, job.axes
    sigma_rad = math.sqrt(2) * (look.sigma_theta_rad or 0.0)
    gate_rad = look.measure.gates.max_turn_rad
    most_rad = MOST_RAD if gate_rad is None else min(MOST_RAD, gate_rad / 2)
    turn_rad = min(max(LEAST_RAD, WANTED * sigma_rad), most_rad)
    readings = rig.readings()
    home, here = readings.reading(axes), rig.beliefs.world(look.target, readings)
    move = inverse_kinematics(axes, readings, here, (here.x_um, here.y_um), turn_rad)
    why = in_the_way(rig, look, move)
    if turn_rad < ENOUGH * sigma_rad:
        why = f"a turn by {turn_rad:.3g} rad does not stand out of {sigma_rad:.3g} rad"
    if why:
        rig.journal.write("probe_turn_skipped", look=look.id, why=why)
        return
    seen = _moved(job, move)
    if seen.theta_rad is None:
        raise ExecutorError("MP824", f"look {look.id} gives no angle")
    turned_rad = math.remainder(seen.theta_rad - theta_rad, math.tau)
    rig.journal.write("probe_turn", look=look.id, told=turn_rad, seen=turned_rad)
    check_turn(turn_rad, turned_rad, sigma_rad, look)
    back = replace(_to(axes, (home.x_um, home.y_um)), theta_rad=home.theta_rad)
    rig.move(back, "probe back")


def _to(axes: AxesName, position: Point) -> AxisMove:
    """Return a move to readings in x and y."""
    return AxisMove(axes=axes, x_um=position[0], y_um=position[1])


def _toward(distance_um: float, step_um: float) -> float:
    """Return a step with the sign of a distance; positive for 0."""
    return -step_um if distance_um < 0 else step_um


def _around(middle: Point, reach_um: float) -> Iterator[Point]:
    """Yield four positions about a middle, each axis from end to end, um."""
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        yield middle[0] + dx * reach_um, middle[1] + dy * reach_um
