"""Verdicts on parts by the simulated cell's own true poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

from microplan.executor.simulated.contact import hole_over
from microplan.executor.simulated.truth import TrueBody, TruePost, Truth

SEATED_UM = 1.0  # a part lying this close to its seat lies on it
TOUCHING_UM = 1e-6  # what was pushed until it touched is inside, whatever rounding does


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Verdict on a part that was to be put onto a post, or next to a mark."""

    success: bool
    offset_um: float  # from the seat's centre to what belongs there
    height_um: float  # of the underside above the seat
    collided: str  # the first collision, "" if there was none
    held: bool  # the tool still carries it
    turn_rad: float = 0.0  # of the part against the seat's, as drawn


def judge(
    truth: Truth,
    target: str,
    on: str,
    within_um: float = 0.0,
    within_rad: float | None = None,
) -> Verdict:
    """Return the verdict on a part; see `Cell.judge`."""
    body = truth.bodies.get(target.partition(".")[0])
    host = truth.bodies.get(on.partition(".")[0])
    if body is None or host is None:
        raise ValueError(f"the cell has no part {target!r} or {on!r}")
    offset_um, seated = _off_seat(truth, target, body, on, host, within_um)
    height_um = truth.under_um(body) - truth.top_um(host)
    held = truth.held == body.part.name
    turn_rad = truth.pose(body).theta_rad - truth.pose(host).theta_rad
    turn_rad = math.remainder(turn_rad, math.tau)
    seated = seated and abs(height_um) <= SEATED_UM
    seated = seated and (within_rad is None or abs(turn_rad) <= within_rad)
    return Verdict(
        success=bool(seated and not held and not truth.collided),
        offset_um=offset_um,
        height_um=float(height_um),
        collided=truth.collided,
        held=held,
        turn_rad=turn_rad,
    )


def _off_seat(
    truth: Truth, target: str, body: TrueBody, on: str, host: TrueBody, within_um: float
) -> tuple[float, bool]:
    """Return how far the target truly is off its seat, um, and whether it is on it."""
    for post in host.posts:
        if post.name == on:
            return _off_post(truth, target, body, host, post)
    x, y = truth.pose(body).apply(*_point(body, target))
    seat_x, seat_y = truth.pose(host).apply(*_point(host, on))
    offset_um = math.hypot(x - seat_x, y - seat_y)
    return offset_um, offset_um <= within_um + TOUCHING_UM


def _off_post(
    truth: Truth, target: str, body: TrueBody, host: TrueBody, post: TruePost
) -> tuple[float, bool]:
    """Return the distance, um, of a hole from a post, and whether it is over it.

    The hole is the target where that names one, else any, the nearest counts.
    """
    if not body.holes:
        raise ValueError(f"{target!r} has no hole")
    seat, pose = truth.pose(host).apply(*post.center_um), truth.pose(body)
    named = [hole for hole in body.holes if hole.name == target] or body.holes
    offset_um = min(math.dist(pose.apply(*hole.center_um), seat) for hole in named)
    over = hole_over(truth, body, host, post, slack_um=TOUCHING_UM)
    return offset_um, over is not None and body.holes[over] in named


def _point(body: TrueBody, name: str) -> tuple[float, float]:
    """Return a hole's centre in its part's frame, um; a part's own is the origin."""
    if name == body.part.name:
        return (0.0, 0.0)
    for hole in body.part.holes:
        if hole.name == name:
            return hole.center_um
    raise ValueError(f"the cell has no post and no hole {name!r}")
