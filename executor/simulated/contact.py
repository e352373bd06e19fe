"""What touches what: jaws, posts, plates and fingers, without friction.

Written from the contact model's words, apart from the compiler's own version of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from executor.simulated.shapes import FloatArray, extent_x, inside, moved
from executor.simulated.truth import Body, Post, Truth
from schemas.pose import Pose

FROM_ABOVE_UM = 3.0  # deeper at once than this is a hit from the side: z steps are 1 um
BENT_UM = 5.0  # pushed farther than this, a post or finger is bent
BEHIND_TIPS_UM = 5.0  # a part's middle must lie at least this far behind the tips


def touch(truth: Truth, *, block: bool = False) -> None:
    """Let everything that now overlaps make contact; call after every small move.

    `block` makes the next insertion come to rest on top of its post.
    """
    held = truth.bodies.get(truth.held)
    if held is not None:
        for host, post in posts(truth):
            if host is not held:
                _meet_post(truth, held, host, post, block=block)
        _meet_plates(truth, held)
        _drop_if_lost(truth, held)
    if truth.tool is not None:
        _check_fingers(truth)


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
        for host, post in posts(truth):
            if body.on_post == post.name:
                _keep_around(truth, body, host, post)
        return
    truth.held = ""
    _drop(truth, body)


def posts(truth: Truth) -> Iterator[tuple[Body, Post]]:
    """Yield every post with the body it stands on, by name."""
    for name in sorted(truth.bodies):
        for post in truth.bodies[name].posts:
            yield truth.bodies[name], post


def post_place(truth: Truth, host: Body, post: Post) -> tuple[float, float]:
    """Return a post's true centre in the world, um."""
    return truth.pose(host).apply(*post.center_um)


def post_top_um(truth: Truth, host: Body, post: Post) -> float:
    """Return the world height of a post's top."""
    return truth.top_um(host) + post.height_um


def hole_error(
    truth: Truth, body: Body, host: Body, post: Post
) -> tuple[float, float, float] | None:
    """Return (dx, dy) from the post to the nearest hole, and their clearance, um."""
    best = None
    px, py = post_place(truth, host, post)
    for hole in body.part.holes:
        x, y = truth.pose(body).apply(*hole.center_um)
        error = (x - px, y - py, body.hole_radius_um[hole.name] - post.radius_um)
        if best is None or math.hypot(*error[:2]) < math.hypot(*best[:2]):
            best = error
    return best


def captured(truth: Truth, body: Body, host: Body, post: Post) -> bool:
    """Return whether a hole of the body is truly over the post."""
    error = hole_error(truth, body, host, post)
    return error is not None and math.hypot(error[0], error[1]) < error[2]


def _meet_post(
    truth: Truth, body: Body, host: Body, post: Post, *, block: bool
) -> None:
    """Thread a held part onto a post, lift it, or note a blow from the side."""
    gap_um = truth.under_um(body) - post_top_um(truth, host, post)
    if body.on_post == post.name:
        if gap_um >= 0:
            body.on_post = ""
        else:
            _keep_around(truth, body, host, post)
        return
    if gap_um >= 0 or truth.top_um(body) <= truth.top_um(host):
        return
    from_above = gap_um > -FROM_ABOVE_UM
    if from_above and not block and captured(truth, body, host, post):
        body.on_post = post.name
    elif _post_under(truth, body, host, post):
        if from_above:
            body.z_um -= gap_um
        else:
            truth.hit(f"{post.name} ran into the side of {body.part.name}")


def _keep_around(truth: Truth, body: Body, host: Body, post: Post) -> None:
    """Push a part whose hole a post stands in, so that the post stays inside."""
    error = hole_error(truth, body, host, post)
    if error is None:
        return
    off_um, clearance_um = math.hypot(error[0], error[1]), max(error[2], 0.0)
    if off_um <= clearance_um:
        return
    push_um = off_um - clearance_um
    ux, uy = -error[0] / off_um, -error[1] / off_um
    pose = truth.pose(body)
    pushed = replace(pose, x_um=pose.x_um + push_um * ux, y_um=pose.y_um + push_um * uy)
    truth.carry(body, body.carrier, pushed, truth.under_um(body))
    if not truth.stuck:  # a part that sticks to one finger peels off it freely
        truth.pushed_um += push_um
    if truth.pushed_um > BENT_UM:
        truth.hit(f"{post.name} was bent by {body.part.name}")


def _meet_plates(truth: Truth, body: Body) -> None:
    """Rest a held part on whatever has come up under it."""
    for floor_um, name in _floors(truth, body):
        depth_um = floor_um - truth.under_um(body)
        if 0 < depth_um <= FROM_ABOVE_UM:
            body.z_um += depth_um
        elif depth_um > 0 and name:
            truth.hit(f"{name} ran into {body.part.name}")


def _floors(truth: Truth, body: Body) -> Iterator[tuple[float, str]]:
    """Yield height and name of the stage and of every top face under the body."""
    yield truth.stage_z_um(), "the stage"
    for name in sorted(truth.bodies):
        other = truth.bodies[name]
        if other is body or other.carrier != "stage":
            continue
        if _overlap(truth, body, other.edge, other.rings, truth.pose(other)):
            yield truth.top_um(other), name


def _drop_if_lost(truth: Truth, body: Body) -> None:
    """Let go of a part that was lifted out of the jaws."""
    tool = truth.tool
    if tool is not None and body.z_um >= tool.thickness_um:
        truth.held = ""
        _drop(truth, body)


def _drop(truth: Truth, body: Body) -> None:
    """Put a free part onto what is under it."""
    under_um = truth.under_um(body)
    floors = [z for z, _ in _floors(truth, body) if z <= under_um + FROM_ABOVE_UM]
    for host, post in posts(truth):
        if host is body or body.on_post == post.name:
            continue
        top_um = post_top_um(truth, host, post)
        if top_um > under_um + FROM_ABOVE_UM:
            continue
        resting = abs(top_um - under_um) < 1e-6  # it already lies on this post
        if not resting and captured(truth, body, host, post):
            body.on_post = post.name
        elif _post_under(truth, body, host, post):
            floors.append(top_um)
    truth.carry(body, "stage", truth.pose(body), max(floors, default=under_um))


def _post_under(truth: Truth, body: Body, host: Body, post: Post) -> bool:
    """Return whether a post that is not in a hole lies under the body's material."""
    error = hole_error(truth, body, host, post)
    if error is not None:
        off_um, radius_um = math.hypot(error[0], error[1]), error[2] + post.radius_um
        if off_um < radius_um:  # the post's middle is under the hole: its rim is not
            return True
    return _overlap(truth, body, post.edge, post.rings, truth.pose(host))


def _overlap(
    truth: Truth,
    body: Body,
    edge: FloatArray,
    rings: tuple[FloatArray, ...],
    pose: Pose,
) -> bool:
    """Return whether a body's outline and another one, at `pose`, share any area."""
    to_body = truth.pose(body).inverse().compose(pose)
    there = moved(edge, to_body)
    away = np.abs(there - np.clip(there, -body.reach_um, body.reach_um)).max(axis=1)
    if (away > 0).all() and not inside(moved(body.edge[:1], to_body.inverse()), rings)[
        0
    ]:
        return False
    if inside(there, body.rings).any():
        return True
    return bool(inside(moved(body.edge, to_body.inverse()), rings).any())


def _between(truth: Truth, body: Body, opening_um: float) -> bool:
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


def _settled(truth: Truth, body: Body) -> float:
    """Return the angle to the jaws that squeezing turns a body to: the nearest minimum.

    A width repeats after half a turn.
    """
    inner = truth.grip_pose().inverse().compose(truth.pose(body)).theta_rad
    turns = [math.remainder(m - inner, math.pi) for m in body.part.hull_minima_rad]
    return inner + min(turns, key=abs, default=0.0)


def _check_fingers(truth: Truth) -> None:
    """Note fingers that touch the stage, a part they do not hold, or a post."""
    tool = truth.tool
    if tool is None:
        return
    low = truth.grip_z_um()
    if low < truth.stage_z_um():
        truth.hit(f"{tool.name} hit the stage")
    for name in sorted(truth.bodies):
        body = truth.bodies[name]
        if name != truth.held and _in_height(
            low, tool.thickness_um, truth.under_um(body), truth.top_um(body)
        ):
            _check_body(truth, tool.name, name, body.edge, truth.pose(body))
        for post in body.posts:
            top = post_top_um(truth, body, post)
            if _in_height(low, tool.thickness_um, truth.top_um(body), top):
                _check_body(truth, tool.name, post.name, post.edge, truth.pose(body))


def _in_height(low: float, thickness: float, bottom: float, top: float) -> bool:
    """Return whether fingers from `low` up share any height with bottom..top."""
    return low < top and low + thickness > bottom


def _check_body(
    truth: Truth, tool: str, name: str, edge: FloatArray, pose: Pose
) -> None:
    """Note a boundary point that lies in a finger, or a finger's tip in the body."""
    there = moved(edge, truth.grip_pose().inverse().compose(pose))
    for side, ring in zip((-1, 1), truth.finger_rings, strict=True):
        shifted = there - np.array([side * truth.opening_um / 2, 0.0])
        low, high = ring.min(axis=0), ring.max(axis=0)
        near = ((shifted >= low) & (shifted <= high)).all(axis=1)
        if near.any() and inside(shifted[near], [ring]).any():
            truth.hit(f"{tool} hit {name}")
            return
