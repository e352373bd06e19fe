"""Verification of a seated part: offset, rotation, height, an empty tool."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.run.focus_sweep import height_by_sweep
from microplan.executor.run.measure_target import UNSEEN, TargetSighting, look_at
from microplan.executor.run.run_context import Rig
from microplan.schemas.plan import HeightSearch, Look, OnFailure, VerifyAction
from microplan.schemas.pose import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class Verified:
    """Result of a verification."""

    offset_um: float
    height_um: float | None  # None: the plan does not ask for it
    turn_rad: float | None = None  # against the seat; None: the same


def verify(
    rig: Rig,
    action: VerifyAction,
    looks: Sequence[Look],
    on_failure: Sequence[OnFailure] = (),
) -> Verified:
    """Return offset and height of a part that passed.

    Raises
    ------
    ExecutorError
        MP802 if the plan names a look that the step has not; MP850 if part or seat is
        not found, MP851 for the offset, MP856 for the rotation, MP852 and MP853 for the
        height, MP854 if the tool may still hold something.
    """
    by_id = {look.id: look for look in looks}
    named = [action.look, action.seat_look]
    named += [] if action.height is None else [action.height.look]
    lost = [name for name in named if name not in by_id]
    if lost:
        raise ExecutorError("MP802", f"a verify names no look {lost[0]!r}")
    part = _find(rig, by_id[action.look], on_failure)
    seat = _find(rig, by_id[action.seat_look], on_failure)
    # the look re-anchored the part; what must be on the seat may be off its middle
    mating = rig.beliefs.world(action.target, rig.readings())
    offset_um = math.hypot(mating.x_um - seat.x_um, mating.y_um - seat.y_um)
    if not offset_um <= action.within_um:
        raise ExecutorError(
            "MP851",
            f"{action.target} is {offset_um:.3g} um off {action.on}, at most "
            f"{action.within_um:.3g} um",
        )
    turn_rad = None
    if action.within_rad is not None:
        turn_rad = check_turn(action, action.within_rad, part, seat)
    height_um = None
    if action.height is not None:
        look = by_id[action.height.look]
        height_um = _check_height(rig, action.height, look, part)
    if action.empty is not None:
        _check_empty(rig, action.empty)
    return Verified(offset_um=offset_um, height_um=height_um, turn_rad=turn_rad)


def _find(rig: Rig, look: Look, on_failure: Sequence[OnFailure]) -> TargetSighting:
    """Look, and call whatever hides the target by verify's own code."""
    try:
        return look_at(rig, look, on_failure)
    except ExecutorError as error:
        if error.code not in UNSEEN:
            raise
        raise ExecutorError(
            "MP850", f"{error} [{error.code}]", cause=error.cause
        ) from error


def check_turn(
    action: VerifyAction, within_rad: float, part: TargetSighting, seat: TargetSighting
) -> float:
    """Return the rotation of the part against its seat, rad."""
    if part.theta_rad is None or seat.theta_rad is None:
        blind = part if part.theta_rad is None else seat
        raise ExecutorError("MP824", f"the look at {blind.target} gives no angle")
    turn_rad = math.remainder(part.theta_rad - seat.theta_rad, math.tau)
    if not abs(turn_rad) <= within_rad:
        raise ExecutorError(
            "MP856",
            f"{action.target} is turned {math.degrees(turn_rad):.3g} deg against "
            f"{action.on}, at most {math.degrees(within_rad):.3g} deg",
        )
    return turn_rad


def _check_height(
    rig: Rig, search: HeightSearch, look: Look, part: TargetSighting
) -> float:
    """Return the height of the part's face, um; MP852 unless it is a seated one's."""
    found = height_by_sweep(rig, search, look, part)
    rig.journal.write("height", z_um=found.z_um, sigma_um=found.sigma_um)
    if not abs(found.z_um - search.expected_um) <= search.within_um:
        raise ExecutorError(
            "MP852",
            f"{part.target} is at {found.z_um:.4g} um, expected "
            f"{search.expected_um:g} um within {search.within_um:g} um",
        )
    return found.z_um


def _check_empty(rig: Rig, tool: str) -> None:
    """Raise unless the tool holds nothing, as far as that can be known.

    The part was just found on its seat, so it is not in the jaws; what is left is that
    the record agrees, and that the tool is out of the picture in which it was found.
    """
    held = rig.beliefs.held_by(tool)
    if held:
        raise ExecutorError("MP854", f"{tool} was never told to let go of {held[0]}")
    if rig.view is None:
        raise ExecutorError("MP854", f"nothing was looked at with {tool} away")
    grip = rig.beliefs.world(tool, rig.readings())
    if in_view(grip, rig.view.field_um):
        raise ExecutorError(
            "MP854", f"{tool} is in view at ({grip.x_um:.4g}, {grip.y_um:.4g}) um"
        )


def in_view(grip: Pose, field_um: tuple[float, float]) -> bool:
    """Return whether the grip, or the fingers that run from it to +y, cross the field.

    The fingers count as an endless ray from the grip; where it meets the field's
    x range and its y range at once, they are in view.
    """
    first_um, last_um = 0.0, math.inf
    ray = (-math.sin(grip.theta_rad), math.cos(grip.theta_rad))
    for start, slope, side in zip((grip.x_um, grip.y_um), ray, field_um, strict=True):
        if abs(slope) < 1e-12:  # parallel to this pair of borders
            if abs(start) > side / 2:
                return False
            continue
        ends = sorted(((-side / 2 - start) / slope, (side / 2 - start) / slope))
        first_um, last_um = max(first_um, ends[0]), min(last_um, ends[1])
    return first_um <= last_um
