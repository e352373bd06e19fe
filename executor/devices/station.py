"""Station of a plan: its devices, with the preflight check of the plan on it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

from microplan.executor.devices.calibration import IDENTITY, Calibration, check_gains
from microplan.executor.devices.device_values import as_number, as_reading
from microplan.executor.devices.drivers import (
    Axes,
    Camera,
    Clock,
    Device,
    Gripper,
    Lens,
    Light,
)
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import (
    AXES,
    Interval,
    Rules,
    check_finite,
    targets,
)
from microplan.executor.devices.timeouts import Caller
from microplan.featuresel.routines.registry import REGISTRY
from microplan.schemas.plan import AxesName, InsertAction, Look, Plan

_MATCH = 1e-5  # relative: plan numbers carry six digits
# A first approach goes by beliefs over some 1000 um, and must end within the 20 um that
# looks are sure to search: a rotation or scale of the image up to 2 % does.
ALIGNED = 0.02
_POINT_UM = 1e-3  # between two points that are the same: a nanometre is rounding


@dataclass(frozen=True, slots=True, kw_only=True)
class Offer:
    """Capabilities of a station's devices; `travel` as in the plan's requirements."""

    width_px: int
    height_px: int
    pitch_um: float
    bits: int
    magnification: Interval
    focus_um: Interval
    opening_um: Interval | None  # None: no jaws
    travel: Mapping[str, Interval]  # "stage.x_um" -> least, most
    theta_axis_um: tuple[float, float]
    calibration: Calibration | None = None  # None: as the plan assumes it
    latency_frames: int = 0  # looks by which a frame is older than it seems


@dataclass(frozen=True, slots=True, kw_only=True)
class Station:
    """Devices, and what they offer."""

    stage: Axes
    robot: Axes | None
    gripper: Gripper | None
    lens: Lens
    light: Light
    camera: Camera
    clock: Clock
    offer: Offer
    rules: Rules = field(default_factory=Rules)

    def axes(self, name: AxesName) -> Axes:
        """Return the axis group called `name`; MP808 if the station has none."""
        if name == "stage":
            return self.stage
        if self.robot is None:
            raise ExecutorError("MP808", "the plan moves a robot, the station has none")
        return self.robot

    def devices(self) -> dict[str, str]:
        """Return model and serial number of every device, by role.

        Raises
        ------
        ExecutorError
            MP841 or MP844 if a device does not answer.
        """
        found = {
            "stage": self.stage, "robot": self.robot, "jaws": self.gripper,
            "lens": self.lens, "light": self.light, "camera": self.camera,
        }  # fmt: skip
        caller, limit_s = Caller(), self.rules.safety.call_s
        return {
            role: caller.call(
                f"the {role}'s model", partial(_described, device), limit_s
            )
            for role, device in found.items()
            if device is not None
        }

    def jaws(self) -> Gripper:
        """Return the gripper; MP807 if the station has none."""
        if self.gripper is None:
            raise ExecutorError("MP807", "the plan needs jaws, the station has none")
        return self.gripper


def _described(device: Device) -> str:
    """Return a device's model and serial number."""
    return f"{device.model} {device.serial}"


def preflight(plan: Plan, station: Station, *, begun: bool = False) -> None:
    """Refuse a plan that this station cannot run.

    Where its run has `begun`, the axes need not be at its start.

    Raises
    ------
    ExecutorError
        The first of MP817, MP801, MP805..MP811, MP814, MP815, MP837 that holds, with
        both values; MP841, MP844 or MP847 if readings cannot be had.
    """
    if plan.status == "sketch":
        raise ExecutorError(
            "MP817",
            f"{plan.name!r} is a sketch: nothing was tried, so that no look can be made"
            "; compile it with --preset fast, balanced or accurate",
        )
    if plan.status != "feasible":
        why = "; ".join(f"{r.code} in {r.step}: {r.message}" for r in plan.reasons)
        raise ExecutorError("MP801", why or "the plan gives no reason")
    _check_camera(plan, station.offer)
    _check_lens(plan, station.offer)
    _check_jaws(plan, station.offer)
    _check_travel(plan, station.offer)
    _check_axis(plan, station.offer)
    _check_calibration(plan, station.offer.calibration)
    _check_speeds(plan, station.rules)
    check_gains(plan, station.offer.latency_frames, station.offer.calibration)
    _check_routines(plan)
    if not begun:
        _check_start(plan, station)


def _check_camera(plan: Plan, offer: Offer) -> None:
    """Pixels, their pitch and the bits must be the same."""
    need = plan.requirements
    for name in ("width_px", "height_px", "pitch_um", "bits"):
        wanted, found = getattr(need, name), getattr(offer, name)
        if not math.isclose(wanted, found, rel_tol=_MATCH):
            raise ExecutorError(
                "MP805", f"the plan needs {name} = {wanted:g}, the camera has {found:g}"
            )


def _check_lens(plan: Plan, offer: Offer) -> None:
    """Every magnification and focus stop must be reachable."""
    need = plan.requirements
    _within("MP806", "magnification", need.magnification, offer.magnification)
    _within("MP806", "focus_um", need.focus_um, offer.focus_um)


def _check_jaws(plan: Plan, offer: Offer) -> None:
    """The openings must be reachable, if the plan grips at all."""
    if plan.opening_start_um is None:
        return
    if offer.opening_um is None:
        raise ExecutorError("MP807", "the plan needs jaws, the station has none")
    _within("MP807", "opening_um", plan.requirements.opening_um, offer.opening_um)


def _check_travel(plan: Plan, offer: Offer) -> None:
    """Every axis' travel must be within its limits."""
    for name, need in plan.requirements.travel.items():
        if name not in offer.travel:
            raise ExecutorError("MP808", f"the station has no axis {name}")
        _within("MP808", name, need, offer.travel[name])


def _check_axis(plan: Plan, offer: Offer) -> None:
    """The stage must rotate about the point the plan was computed with."""
    need, found = plan.requirements.theta_axis_um, offer.theta_axis_um
    if math.dist(need, found) > _POINT_UM:
        raise ExecutorError(
            "MP809", f"the plan turns about {need} um, the stage about {found} um"
        )


def _check_calibration(plan: Plan, found: Calibration | None) -> None:
    """Image and stage must go the same direction, and every look's scale be usable."""
    if found is None:
        return
    rows = found.camera_from_stage
    if found.mirrored:
        raise ExecutorError("MP814", f"the image is mirrored to the stage: {rows}")
    apart = max(
        abs(a - b)
        for row, plain in zip(rows, IDENTITY, strict=True)
        for a, b in zip(row, plain, strict=True)
    )
    if apart > ALIGNED:
        raise ExecutorError(
            "MP814",
            f"the image follows the stage by {rows}, the plan needs {IDENTITY} within "
            f"{ALIGNED:g}",
        )
    for step in plan.steps:
        for look in step.looks:
            _check_scale(look, found)


def _check_scale(look: Look, found: Calibration) -> None:
    """The scale at a look's zoom must be one that every feature's trials allow."""
    point = found.at(look.view.magnification)
    if point is None:
        raise ExecutorError(
            "MP814",
            f"look {look.id}: no calibration at {look.view.magnification:g} x",
        )
    ratio = look.view.um_per_px / point.um_per_px
    for measure in look.measures:
        low, high = measure.usable_magnification
        if not low * (1 - _MATCH) <= ratio <= high * (1 + _MATCH):
            raise ExecutorError(
                "MP814",
                f"look {look.id}: the station has {point.um_per_px:.6g} um per px, the "
                f"plan {look.view.um_per_px:.6g}; usable are {low:g}..{high:g} of it",
            )


def _check_speeds(plan: Plan, rules: Rules) -> None:
    """No move may be faster, no correction larger, than its phase allows."""
    servo_um = rules.safety.phase("servo").step_um
    for step in plan.steps:
        most = rules.safety.phase("approach").speed_um_per_s
        moves = [(most, move) for move in step.moves]
        if isinstance(step.action, InsertAction):
            most = rules.safety.phase("insert").speed_um_per_s
            moves += [(most, move) for move in step.action.moves]
        for limit, move in moves:
            if (move.speed_um_per_s or 0.0) > limit * (1 + _MATCH):
                raise ExecutorError(
                    "MP815",
                    f"step {step.id} moves the {move.axes} at "
                    f"{move.speed_um_per_s:g} um/s, at most {limit:g} um/s",
                )
        if step.control is not None and step.control.max_step_um > servo_um:
            raise ExecutorError(
                "MP815",
                f"step {step.id} corrects by up to {step.control.max_step_um:g} um, at "
                f"most {servo_um:g} um",
            )


def _check_routines(plan: Plan) -> None:
    """Every routine of every look must be installed."""
    for step in plan.steps:
        for look in step.looks:
            for measure in look.measures:
                for use in (*measure.chain, *measure.fallback):
                    if use.id not in REGISTRY:
                        raise ExecutorError(
                            "MP810", f"look {look.id} needs routine {use.id!r}"
                        )


def _check_start(plan: Plan, station: Station) -> None:
    """The readings before step 1 must be those the plan starts from."""
    starts = [m for m in (plan.stage_start, plan.robot_start) if m is not None]
    caller, limit_s = Caller(), station.rules.safety.call_s
    for start in starts:
        axes, settle = station.axes(start.axes), station.rules.settle(start.axes)
        name = f"{start.axes}.reading"
        reading = as_reading(name, caller.call(name, axes.reading, limit_s))
        check_finite(start.axes, {axis: getattr(reading, axis) for axis in AXES})
        for name, wanted in targets(start).items():
            found = getattr(reading, name)
            if not abs(wanted - found) <= settle.window(name) + _MATCH * abs(wanted):
                raise ExecutorError(
                    "MP811",
                    f"{start.axes}.{name} reads {found:g}, the plan starts at "
                    f"{wanted:g}",
                )
    opening_um = plan.opening_start_um
    if opening_um is None:
        return
    reads_um = as_number(
        "jaws.reading", caller.call("jaws.reading", station.jaws().reading, limit_s)
    )
    check_finite("jaws", {"opening_um": reads_um})
    window_um = station.rules.jaws_window_um
    if not abs(reads_um - opening_um) <= window_um + _MATCH * abs(opening_um):
        raise ExecutorError(
            "MP811",
            f"the jaws read {reads_um:g} um, the plan starts at {opening_um:g} um",
        )


def _within(code: str, name: str, need: Interval, offer: Interval) -> None:
    """Raise `code` unless the interval `need` lies in `offer`."""
    slack = _MATCH * max(abs(v) for v in (*need, *offer))
    if need[0] < offer[0] - slack or need[1] > offer[1] + slack:
        raise ExecutorError(
            code,
            f"the plan needs {name} {need[0]:g}..{need[1]:g}, "
            f"the station has {offer[0]:g}..{offer[1]:g}",
        )
