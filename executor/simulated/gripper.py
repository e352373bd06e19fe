"""Jaws of the simulated cell: grasping, releasing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from microplan.executor.simulated.contact import drop, lean, touch
from microplan.executor.simulated.outlines.crossing import moved
from microplan.executor.simulated.outlines.squeezing import settled_rad
from microplan.executor.simulated.shapes import extent_x
from microplan.executor.simulated.timeline import DelayedDevice, DeviceFaults, Timeline
from microplan.executor.simulated.truth import TrueBody, Truth
from microplan.schemas.pose import Pose

BEHIND_TIPS_UM = 5.0  # a part's middle must lie at least this far behind the tips


def close_jaws(truth: Truth, opening_um: float) -> None:
    """Close the jaws; a part between them is centred, rotated and held.

    They stop at it. A part that sticks to one finger comes along with that, until both
    hold it.
    """
    held, before = truth.bodies.get(truth.held), truth.opening_um
    if held is None:
        _grasp(truth, opening_um)
    truth.opening_um = stopped_um(truth, opening_um)
    if held is not None and truth.stuck:
        _shift(held, _finger_side(held) * (truth.opening_um - before) / 2)
        truth.stuck = truth.opening_um <= opening_um


def stopped_um(truth: Truth, opening_um: float) -> float:
    """Return where jaws stop that go to an opening: no nearer than a part is wide.

    Of the parts between them, as they were made and as they stand to the jaws; what is
    held is between them even if it touches one at their widest.
    """
    if truth.tool is None:
        return opening_um
    widest, grip = truth.tool.opening_um[1], truth.grip_pose().inverse()
    for name, body in truth.bodies.items():
        if body.posts:
            continue
        if name == truth.held or _between(truth, body, widest):
            theta_rad = grip.compose(truth.pose(body)).theta_rad
            low, high = extent_x(body.edge, theta_rad)
            opening_um = max(opening_um, high - low)
    return opening_um


def _grasp(truth: Truth, opening_um: float) -> None:
    """Centre, rotate and hold a part between jaws that are about to close."""
    for name in sorted(truth.bodies):
        body = truth.bodies[name]
        if body.posts or not _between(truth, body, truth.opening_um):
            continue
        theta_rad = _settled(truth, body)
        low, high = extent_x(body.edge, theta_rad)
        if high - low <= opening_um:
            continue  # the jaws close without touching it
        grip, under = truth.grip_pose(), truth.under_um(body)
        y_um = grip.inverse().compose(truth.pose(body)).y_um
        inner = Pose(x_um=-(low + high) / 2, y_um=y_um, theta_rad=theta_rad)
        truth.carry(body, "robot", grip.compose(inner), under)
        truth.held, truth.stuck = name, False
        return


def open_jaws(truth: Truth, opening_um: float, *, stick_side: float = 0.0) -> None:
    """Open the jaws; the part stays, or follows the finger on `stick_side` (+-1).

    One that sticks already goes on with its own finger.
    """
    body, before = truth.bodies.get(truth.held), truth.opening_um
    truth.opening_um = opening_um if body is None else stopped_um(truth, opening_um)
    if body is None or truth.opening_um > opening_um:
        return  # empty, or still squeezed
    if stick_side:
        side = _finger_side(body) if truth.stuck else stick_side
        _shift(body, side * (opening_um - before) / 2)
        truth.stuck = True
        lean(truth, body)
        return
    truth.held = ""
    drop(truth, body)


def _finger_side(body: TrueBody) -> float:
    """Return the side of the finger that a held part is nearer to, +-1."""
    low, high = extent_x(body.edge, body.pose.theta_rad)
    return math.copysign(1.0, (low + high) / 2 + body.pose.x_um)


def _shift(body: TrueBody, by_um: float) -> None:
    """Move a held part across the jaws."""
    body.pose = replace(body.pose, x_um=body.pose.x_um + by_um)


def _between(truth: Truth, body: TrueBody, opening_um: float) -> bool:
    """Return whether a body lies between the open jaws."""
    tool = truth.tool
    if tool is None:
        return False
    at = truth.grip_pose().inverse().compose(truth.pose(body))
    points = moved(body.edge, at)
    middle_y = float(points[:, 1].min() + points[:, 1].max()) / 2
    bottom, top = truth.under_um(body), truth.top_um(body)
    grip_z = truth.grip_z_um()
    return (
        float(np.abs(points[:, 0]).max()) <= opening_um / 2
        and truth.tip_y_um + BEHIND_TIPS_UM < middle_y
        and middle_y < max(float(ring[:, 1].max()) for ring in truth.finger_rings)
        and bottom < grip_z + tool.thickness_um
        and top > grip_z
    )


def _settled(truth: Truth, body: TrueBody) -> float:
    """Return the angle of a squeezed body to the jaws, rad."""
    inner = truth.grip_pose().inverse().compose(truth.pose(body)).theta_rad
    return settled_rad(np.concatenate(body.rings), inner)


JAW_TIME_S = 0.3  # the workcell states none


class SimGripper(DelayedDevice):
    """Jaws; `stick` is the probability that a released part follows a finger."""

    def __init__(
        self,
        timeline: Timeline,
        rng: np.random.Generator,
        trouble: DeviceFaults,
        *,
        stick: float = 0.0,
    ) -> None:
        super().__init__(timeline, trouble)
        self.model, self.serial = "simulated jaws", "sim-jaws"
        self._truth = timeline.truth
        self._rng = rng
        self._stick = stick
        self._commanded = self._truth.opening_um
        self._target_um = self._commanded

    def start(self, opening_um: float) -> None:
        """Begin to open or close; see `microplan.executor.devices.drivers.Gripper`."""
        tool = self._truth.tool
        low, high = (0.0, 0.0) if tool is None else tool.opening_um
        if not (math.isfinite(opening_um) and low <= opening_um <= high):
            raise ValueError(
                f"opening {opening_um:g} um is outside {low:g}..{high:g} um"
            )
        self._trouble.refuse("raise")
        self._begin(JAW_TIME_S, opening_um)
        self._timeline.changed()

    def move(self, opening_um: float) -> None:
        """Start a motion and let the cell's time pass until it has ended."""
        self.start(opening_um)
        self._timeline.run_out(self.motion)

    def reading(self) -> float:
        """Return the commanded opening: the drive does not feel what it holds."""
        if self.motion.pending():
            self._trouble.hang("hang")
            if self._trouble.on("nan"):
                return math.nan
        return self._commanded

    def state(self) -> dict[str, Any]:
        """Return the command, and the motion under way."""
        return {
            "commanded_um": self._commanded,
            "target_um": self._target_um,
            "left_s": self.motion.left_s(),
        }

    def restore(self, data: Mapping[str, Any]) -> None:
        """Be where `state` says."""
        self._commanded, self._target_um = data["commanded_um"], data["target_um"]
        if data["left_s"] is not None:
            self._begin(data["left_s"], data["target_um"])

    def _begin(self, seconds: float, opening_um: float) -> None:
        """Begin a motion that ends in `seconds`."""
        self._target_um = opening_um
        self.motion.begin(seconds, lambda: self._arrive(opening_um))

    def _arrive(self, opening_um: float) -> None:
        """Be at the new opening, with whatever is between the jaws or was."""
        if self._trouble.on("stuck"):
            return
        if opening_um < self._truth.opening_um:
            close_jaws(self._truth, opening_um)
        else:
            holds = bool(self._truth.held)
            chance = 1.0 if holds and self._trouble.faults.on("stick") else self._stick
            sticks, side = self._rng.random(2)
            stuck = float(np.sign(side - 0.5)) if sticks < chance else 0.0
            open_jaws(self._truth, opening_um, stick_side=stuck)
        self._commanded = opening_um
        touch(self._truth)
