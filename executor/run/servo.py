"""Alignment: move, look, correct, until the target is where it should be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.motion.inverse_kinematics import inverse_kinematics
from microplan.executor.run.measure_target import UNSEEN, TargetSighting
from microplan.executor.run.probe import look_probed
from microplan.executor.run.run_context import Rig
from microplan.executor.run.warm_start import WarmStart
from microplan.schemas.plan import AlignAction, AxisMove, Control, Look, OnFailure

# A tolerance below .6 move sigmas is refused by the compiler, so sigma <= t / .6. Axes
# that land about their reading leave an error of sigma sqrt(2 / (2 - gain)) per axis
# after a correction; beyond five of them is one look in 270 000 (Rayleigh).
NOISE_PER_TOLERANCE = 5 / 0.6


@dataclass(frozen=True, slots=True, kw_only=True)
class Aligned:
    """Result of an alignment."""

    cycles: int  # looks; each followed a move, the first the approach
    error_um: float  # |goal - measured| of the last look
    spread_um: float  # the routine's own sigma at the last look


def align(
    rig: Rig,
    action: AlignAction,
    look: Look,
    control: Control,
    on_failure: Sequence[OnFailure] = (),
) -> Aligned:
    """Bring the target to its goal and stop inside the tolerance.

    The first approach goes by beliefs along `action.path`; every correction moves by
    gain times the measured error. Nothing moves once the raw error is inside the
    tolerance: correcting for ever is noisier. `look_then_move` corrects once, fully,
    wherever it is, without another look. A target that is lost after a correction is
    looked for once more from where it was seen last.

    Raises
    ------
    ExecutorError
        MP830 after `max_cycles` looks, MP831 if the error grows beyond what
        noise explains, MP832 if a correction is too large; codes of `look_probed`.
    """
    rig.phase = "approach"
    approach(rig, action, control)
    rig.phase = "servo"
    errors_um = list(rig.resume_state.errors_um)  # before the executor was killed
    watch, warm_start = _Watch(action), None
    while True:
        seen = watch.look(rig, look, on_failure, warm_start)
        if control.tolerance_theta_rad is not None and seen.theta_rad is None:
            raise ExecutorError("MP824", f"look {look.id} gives no angle")
        error_um, turn_rad = _error(rig, action)
        errors_um.append(error_um)
        ended = Aligned(
            cycles=len(errors_um), error_um=error_um, spread_um=seen.spread_um
        )
        rig.journal.write("error", error_um=error_um, turn_rad=turn_rad)
        rig.write_ahead.write("error", error_um=error_um)
        servo = control.method == "servo"
        if servo and _inside(error_um, turn_rad, control):
            return ended
        _check(errors_um, turn_rad, control, action)
        if not servo:
            rig.move(correction(rig, action, control, 1.0))
            return ended
        still_rad = control.tolerance_theta_rad or 0.0
        move = correction(rig, action, control, control.gain, still_rad)
        rig.move(move)
        warm_start = _warm_start(seen, look, control, move)


def _warm_start(
    seen: TargetSighting, look: Look, control: Control, move: AxisMove
) -> WarmStart | None:
    """Return where a look's features must be after a correction, if that is known.

    What has turned may have swung aside.
    """
    if control.move_sigma_um is None or move.theta_rad is not None:
        return None
    sigma_um = math.hypot(control.move_sigma_um, look.measure.sigma_xy_um)
    return WarmStart(features=seen.features, sigma_um=sigma_um)


class _Watch:
    """Looks of one alignment; a target that was seen may be lost once."""

    def __init__(self, action: AlignAction) -> None:
        self._action = action
        self._seen_at: AxisMove | None = None
        self._lost = False

    def look(
        self,
        rig: Rig,
        look: Look,
        on_failure: Sequence[OnFailure],
        warm_start: WarmStart | None,
    ) -> TargetSighting:
        """Look; a target that is lost is looked for where it was seen last."""
        try:
            seen = look_probed(rig, look, on_failure, warm_start=warm_start)
        except ExecutorError as error:
            back = self._seen_at
            if self._lost or back is None or error.code not in UNSEEN:
                raise
            self._lost = True
            rig.journal.write("lost", look=look.id, code=error.code, back=back)
            rig.move(back)
            seen = look_probed(rig, look, on_failure)
        axes = self._action.axes
        now = rig.readings().reading(axes)
        self._seen_at = AxisMove(
            axes=axes, x_um=now.x_um, y_um=now.y_um, theta_rad=now.theta_rad
        )
        return seen


def approach(rig: Rig, action: AlignAction, control: Control) -> None:
    """Go where the beliefs are, one entry of the path after the other."""
    final = correction(rig, action, control, 1.0)
    for number, axes in enumerate(action.path):
        rig.move(
            AxisMove(
                axes=action.axes,
                x_um=final.x_um if "x" in axes else None,
                y_um=final.y_um if "y" in axes else None,
                theta_rad=final.theta_rad if number == 0 else None,
            ),
            f"approach {number + 1}",
        )


def correction(
    rig: Rig,
    action: AlignAction,
    control: Control,
    gain: float,
    still_rad: float = 0.0,
) -> AxisMove:
    """Return the readings that take the target `gain` times the distance to its goal.

    A rotation is made fully, and compensated in x and y by the same move. An angle
    within `still_rad` of its goal is left: a rotation lands with a new error, which
    moves the target by its distance from the axis times that.
    """
    readings = rig.readings()
    here = rig.beliefs.world(action.target, readings)
    goal = rig.beliefs.world(action.to, readings)
    turn_rad = 0.0
    if control.tolerance_theta_rad is not None:
        turn_rad = math.remainder(goal.theta_rad - here.theta_rad, 2 * math.pi)
        if abs(turn_rad) <= still_rad:
            turn_rad = 0.0
    wanted = (
        here.x_um + gain * (goal.x_um - here.x_um),
        here.y_um + gain * (goal.y_um - here.y_um),
    )
    return inverse_kinematics(action.axes, readings, here, wanted, turn_rad)


def _error(rig: Rig, action: AlignAction) -> tuple[float, float]:
    """Return distance (um) and rotation (rad) from the measured target to its goal."""
    readings = rig.readings()
    here = rig.beliefs.world(action.target, readings)
    goal = rig.beliefs.world(action.to, readings)
    distance = math.hypot(goal.x_um - here.x_um, goal.y_um - here.y_um)
    return distance, math.remainder(goal.theta_rad - here.theta_rad, 2 * math.pi)


def _inside(error_um: float, turn_rad: float, control: Control) -> bool:
    """Return whether the measured error is within tolerance."""
    limit_rad = control.tolerance_theta_rad
    turned = limit_rad is None or abs(turn_rad) <= limit_rad
    return error_um <= control.tolerance_xy_um and turned


def _check(
    errors_um: Sequence[float], turn_rad: float, control: Control, action: AlignAction
) -> None:
    """Raise if the alignment runs away, steps too far or takes too long."""
    if diverges(errors_um, control.tolerance_xy_um, control.gain):
        path = ", ".join(f"{e:.3g}" for e in errors_um[-3:])
        raise ExecutorError(
            "MP831",
            f"{action.target} moves away from {action.to}: errors {path} um; is a "
            "camera axis mirrored or swapped?",
        )
    if errors_um[-1] > control.max_step_um:
        raise ExecutorError(
            "MP832",
            f"{action.target} is {errors_um[-1]:.3g} um from {action.to}, a "
            f"correction may be {control.max_step_um:.3g} um",
        )
    if control.method == "servo" and len(errors_um) >= control.max_cycles:
        raise ExecutorError(
            "MP830",
            f"{action.target} is {errors_um[-1]:.3g} um from {action.to} after "
            f"{control.max_cycles} looks, needs {control.tolerance_xy_um:.3g} um"
            + _turned(turn_rad, control.tolerance_theta_rad),
        )


def _turned(turn_rad: float, limit_rad: float | None) -> str:
    """Return what is left of an angle that must be met, in words."""
    if limit_rad is None:
        return ""
    left, limit = math.degrees(turn_rad), math.degrees(limit_rad)
    return f"; turned by {left:.3g} deg, needs {limit:.3g} deg"


def diverges(errors_um: Sequence[float], tolerance_um: float, gain: float) -> bool:
    """Return whether the last two corrections both made it worse, beyond noise.

    From a gain of 2 on nothing settles, and noise excuses nothing.
    """
    if len(errors_um) < 3:
        return False
    first, second, third = errors_um[-3:]
    noise_um = 0.0
    if gain < 2:
        noise_um = NOISE_PER_TOLERANCE * math.sqrt(2 / (2 - gain)) * tolerance_um
    return first < second < third and third > noise_um
