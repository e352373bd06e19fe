"""Closing jaws take what is between them; opening jaws let go, or do not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from microplan.executor.simulated.contact import drop, lean
from microplan.executor.simulated.shapes import extent_x, moved
from microplan.executor.simulated.truth import TrueBody, Truth
from microplan.schemas.pose import Pose

BEHIND_TIPS_UM = 5.0  # a part's middle must lie at least this far behind the tips


def close_jaws(truth: Truth, opening_um: float) -> None:
    """Close the jaws; a part between them is centred, turned and held."""
    truth.opening_um, before = opening_um, truth.opening_um
    if truth.held:
        return
    for name in sorted(truth.bodies):
        body = truth.bodies[name]
        if body.posts or not _between(truth, body, before):
            continue
        theta_rad = _settled(truth, body)
        low, high = extent_x(body.edge, theta_rad)
        if high - low <= opening_um:
            continue  # the jaws close beside it and hold nothing
        grip, under = truth.grip_pose(), truth.under_um(body)
        y_um = grip.inverse().compose(truth.pose(body)).y_um
        inner = Pose(x_um=-(low + high) / 2, y_um=y_um, theta_rad=theta_rad)
        truth.carry(body, "robot", grip.compose(inner), under)
        truth.held, truth.stuck, truth.opening_um = name, False, high - low
        body.on_post = ""
        return


def open_jaws(truth: Truth, opening_um: float, *, stick_side: float = 0.0) -> None:
    """Open the jaws; the part stays, or follows the finger on `stick_side` (+-1)."""
    before, truth.opening_um = truth.opening_um, opening_um
    body = truth.bodies.get(truth.held)
    if body is None:
        return
    low, high = extent_x(body.edge, body.pose.theta_rad)
    if opening_um <= high - low:
        return  # still squeezed
    if stick_side:
        shift_um = stick_side * (opening_um - before) / 2
        body.pose = replace(body.pose, x_um=body.pose.x_um + shift_um)
        truth.stuck = True
        lean(truth, body)
        return
    truth.held = ""
    drop(truth, body)


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
    """Return the angle to the jaws that squeezing turns a body to: the nearest minimum.

    A width repeats after half a turn.
    """
    inner = truth.grip_pose().inverse().compose(truth.pose(body)).theta_rad
    turns = [math.remainder(m - inner, math.pi) for m in body.part.hull_minima_rad]
    return inner + min(turns, key=abs, default=0.0)
