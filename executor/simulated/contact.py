"""Contact model of the simulated cell: seating, wedging, collisions of fingers.

Written from the contact model's words, apart from the compiler's own version of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.simulated.shapes import inside, moved
from microplan.executor.simulated.truth import TrueBody, TruePost, Truth
from microplan.schemas.pose import Pose


def check_fingers(truth: Truth) -> None:
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
            top = truth.post_top_um(body, post)
            if _in_height(low, tool.thickness_um, truth.top_um(body), top):
                _check_body(truth, tool.name, post.name, post.edge, truth.pose(body))


def _in_height(low: float, thickness: float, bottom: float, top: float) -> bool:
    """Return whether fingers from `low` up share any height with bottom..top."""
    return low < top and low + thickness > bottom


def _check_body(
    truth: Truth, tool: str, name: str, edge: FloatArray, pose: Pose
) -> None:
    """Note it if a boundary point of the body lies in a finger."""
    there = moved(edge, truth.grip_pose().inverse().compose(pose))
    for side, ring in zip((-1, 1), truth.finger_rings, strict=True):
        shifted = there - np.array([side * truth.opening_um / 2, 0.0])
        low, high = ring.min(axis=0), ring.max(axis=0)
        near = ((shifted >= low) & (shifted <= high)).all(axis=1)
        if near.any() and inside(shifted[near], [ring]).any():
            truth.hit(f"{tool} hit {name}")
            return


FROM_ABOVE_UM = 3.0  # deeper at once than this is a hit from the side: z steps are 1 um
BENT_UM = 5.0  # pushed farther than this, a post or finger is bent


def touch(truth: Truth, block: Callable[[], bool] = lambda: False) -> None:
    """Let everything that now overlaps make contact; call after every small move.

    `block` is asked when a hole is over its post, and returns whether it rests on top.
    """
    held = truth.bodies.get(truth.held)
    if held is not None:
        for host, post in posts(truth):
            if host is not held:
                _meet_post(truth, held, host, post, block)
        _meet_plates(truth, held)
        _drop_if_lost(truth, held)
    if truth.tool is not None:
        check_fingers(truth)


def posts(truth: Truth) -> Iterator[tuple[TrueBody, TruePost]]:
    """Yield every post with its body, by name."""
    for name in sorted(truth.bodies):
        for post in truth.bodies[name].posts:
            yield truth.bodies[name], post


def post_place(truth: Truth, host: TrueBody, post: TruePost) -> tuple[float, float]:
    """Return a post's true centre in the world, um."""
    return truth.pose(host).apply(*post.center_um)


def hole_error(
    truth: Truth, body: TrueBody, host: TrueBody, post: TruePost
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


def captured(truth: Truth, body: TrueBody, host: TrueBody, post: TruePost) -> bool:
    """Return whether a hole of the body is truly over the post."""
    error = hole_error(truth, body, host, post)
    return error is not None and math.hypot(error[0], error[1]) < error[2]


def _meet_post(
    truth: Truth,
    body: TrueBody,
    host: TrueBody,
    post: TruePost,
    block: Callable[[], bool],
) -> None:
    """Thread a held part onto a post, lift it, or note a blow from the side."""
    gap_um = truth.under_um(body) - truth.post_top_um(host, post)
    if body.on_post == post.name:
        if gap_um >= 0:
            body.on_post = ""
        else:
            keep_around(truth, body, host, post)
        return
    if gap_um >= 0 or truth.top_um(body) <= truth.top_um(host):
        return
    from_above = gap_um > -FROM_ABOVE_UM
    if from_above and captured(truth, body, host, post) and not block():
        body.on_post = post.name
    elif _post_under(truth, body, host, post):
        if from_above:
            body.z_um -= gap_um
        else:
            truth.hit(f"{post.name} ran into the side of {body.part.name}")


def keep_around(truth: Truth, body: TrueBody, host: TrueBody, post: TruePost) -> None:
    """Push a part whose hole is around a post, so that the post stays inside."""
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


def _meet_plates(truth: Truth, body: TrueBody) -> None:
    """Rest a held part on whatever has come up under it."""
    for floor_um, name in _floors(truth, body, above_um=truth.under_um(body)):
        depth_um = floor_um - truth.under_um(body)
        if depth_um <= FROM_ABOVE_UM:
            body.z_um += max(depth_um, 0.0)
        else:
            truth.hit(f"{name} ran into {body.part.name}")


def _floors(
    truth: Truth, body: TrueBody, *, above_um: float = -math.inf
) -> Iterator[tuple[float, str]]:
    """Yield height (um) and name of faces under or in a body that are above."""
    if truth.stage_z_um() > above_um:
        yield truth.stage_z_um(), "the stage"
    for name in sorted(truth.bodies):
        other = truth.bodies[name]
        if other is body or other.carrier != "stage":
            continue
        if truth.top_um(other) <= above_um:
            continue
        if _overlap(truth, body, other.edge, other.rings, truth.pose(other)):
            yield truth.top_um(other), name


def _drop_if_lost(truth: Truth, body: TrueBody) -> None:
    """Let go of a part that was lifted out of the jaws."""
    tool = truth.tool
    if tool is not None and body.z_um >= tool.thickness_um:
        truth.held = ""
        drop(truth, body)


def lean(truth: Truth, body: TrueBody) -> None:
    """Let the post in a part's hole push, however far it drifted since."""
    for host, post in posts(truth):
        if body.on_post == post.name:
            keep_around(truth, body, host, post)


def drop(truth: Truth, body: TrueBody) -> None:
    """Put a free part onto what is under it."""
    lean(truth, body)
    under_um = truth.under_um(body)
    floors = [z for z, _ in _floors(truth, body) if z <= under_um + FROM_ABOVE_UM]
    for host, post in posts(truth):
        if host is body or body.on_post == post.name:
            continue
        top_um = truth.post_top_um(host, post)
        if top_um > under_um + FROM_ABOVE_UM:
            continue
        resting = abs(top_um - under_um) < 1e-6  # it already lies on this post
        if not resting and captured(truth, body, host, post):
            body.on_post = post.name
        elif _post_under(truth, body, host, post):
            floors.append(top_um)
    truth.carry(body, "stage", truth.pose(body), max(floors, default=under_um))


def _post_under(truth: Truth, body: TrueBody, host: TrueBody, post: TruePost) -> bool:
    """Return whether a post that is not in a hole lies under the body's material."""
    error = hole_error(truth, body, host, post)
    if error is not None:
        off_um, radius_um = math.hypot(error[0], error[1]), error[2] + post.radius_um
        if off_um < radius_um:  # the post's middle is under the hole: its rim is not
            return True
    return _overlap(truth, body, post.edge, post.rings, truth.pose(host))


def _overlap(
    truth: Truth,
    body: TrueBody,
    edge: FloatArray,
    rings: tuple[FloatArray, ...],
    pose: Pose,
) -> bool:
    """Return whether a body's outline and another one, at `pose`, share any area."""
    to_body = truth.pose(body).inverse().compose(pose)
    there = moved(edge, to_body)
    away = np.abs(there - np.clip(there, -body.reach_um, body.reach_um)).max(axis=1)
    first = moved(body.edge[:1], to_body.inverse())
    if (away > 0).all() and not inside(first, rings)[0]:
        return False
    if inside(there, body.rings).any():
        return True
    return bool(inside(moved(body.edge, to_body.inverse()), rings).any())
