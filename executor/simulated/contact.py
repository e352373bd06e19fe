"""Contact model of the simulated cell: seating, resting, pushing, collisions.

Written from the contact model's words, apart from the compiler's own version of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.simulated.outlines.containment import (
    PoseAnswer,
    decided,
    meets,
    over,
)
from microplan.executor.simulated.outlines.crossing import (
    enclosed,
    moved,
    share_area,
)
from microplan.executor.simulated.outlines.pushing import smallest_motion
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
        if near.any() and enclosed(shifted[near], ring).any():
            truth.hit(f"{tool} hit {name}")
            return


FROM_ABOVE_UM = 3.0  # deeper at once than this is a hit from the side: z steps are 1 um
MATERIAL = -1  # in place of a hole's number: about the part's material
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
        lean(truth, held)
        _meet_plates(truth, held)
        _drop_if_lost(truth, held)
    if truth.tool is not None:
        check_fingers(truth)


def posts(truth: Truth) -> Iterator[tuple[TrueBody, TruePost]]:
    """Yield every post with its body, by name."""
    for name in sorted(truth.bodies):
        for post in truth.bodies[name].posts:
            yield truth.bodies[name], post


def hole_over(
    truth: Truth, body: TrueBody, host: TrueBody, post: TruePost, *, slack_um: float = 0
) -> int | None:
    """Return the number of the hole that is truly over a post, None if none is.

    Any hole of the body's outline takes any post whose outline lies inside it.
    `slack_um` is forgiven to the centres of round pairs: a pushed part touches.
    """
    pose = truth.pose(body)
    x, y = truth.pose(host).apply(*post.ring.center_um)
    for i, hole in enumerate(body.holes):
        off_um = math.dist(pose.apply(*hole.ring.center_um), (x, y))
        known = decided(hole.ring, post.ring, off_um - slack_um)
        if known is None:
            known = _is_over(truth, body, i, host, post)
        if known:
            return i
    return None


def _is_over(
    truth: Truth, body: TrueBody, hole: int, host: TrueBody, post: TruePost
) -> bool:
    """Return whether a hole goes over a post by their polygons."""
    ask = partial(over, body.holes[hole].ring, post.ring)
    at = _relative(truth, body, host)
    return _answer(body, (post.name, hole), post, at, ask)


def _answer(
    body: TrueBody,
    about: tuple[str, int],
    post: TruePost,
    at: Pose,
    ask: Callable[[Pose], PoseAnswer],
) -> bool:
    """Return an answer about a post at a pose, the last one while that holds."""
    last = body.answers.get(about)
    if last is None or not last.holds_at(post.ring, at):
        last = body.answers[about] = ask(at)
    return last.yes


def _relative(truth: Truth, body: TrueBody, host: TrueBody) -> Pose:
    """Return the pose of a host in a body's frame."""
    return truth.pose(body).inverse().compose(truth.pose(host))


def _meet_post(
    truth: Truth,
    body: TrueBody,
    host: TrueBody,
    post: TruePost,
    block: Callable[[], bool],
) -> None:
    """Thread a held part onto a post, lift it, or note a blow from the side."""
    gap_um = truth.under_um(body) - truth.post_top_um(host, post)
    if post.name in body.on_posts:
        if gap_um >= 0:
            del body.on_posts[post.name]
        return
    if gap_um >= 0 or truth.top_um(body) <= truth.top_um(host):
        return
    from_above = gap_um > -FROM_ABOVE_UM
    hole = hole_over(truth, body, host, post)
    if from_above and hole is not None and not block():
        body.on_posts[post.name] = hole
    elif hole is not None or _post_under(truth, body, host, post):
        if from_above:
            body.z_um -= gap_um
        else:
            truth.hit(f"{post.name} ran into the side of {body.part.name}")


def lean(truth: Truth, body: TrueBody) -> None:
    """Push a part by the posts in its holes, so that each stays inside its hole.

    However far it drifted since: the part gives way by the smallest motion, in the
    sense of `smallest_motion`. Round pairs push straight, and turn nothing.
    """
    if not body.on_posts:
        return
    threaded = [
        (host, post, body.on_posts[post.name])
        for host, post in posts(truth)
        if post.name in body.on_posts
    ]
    pushed = _pushed(truth, body, threaded)
    bent = f"{threaded[0][1].name} was bent by {body.part.name}"
    if pushed is None:
        truth.hit(bent)
        return
    pose, push_um = pushed
    if push_um == 0:
        return
    truth.carry(body, body.carrier, pose, truth.under_um(body))
    if not truth.stuck:  # a part that sticks to one finger peels off it freely
        truth.pushed_um += push_um
    if truth.pushed_um > BENT_UM:
        truth.hit(bent)


_Threaded = tuple[TrueBody, TruePost, int]  # a post's body, the post, its hole


def _pushed(
    truth: Truth, body: TrueBody, threaded: list[_Threaded]
) -> tuple[Pose, float] | None:
    """Return where posts push a part and how far, um; None if nowhere is room."""
    pose = truth.pose(body)
    shifts = [_shift(truth, body, one) for one in threaded]
    if len(shifts) == 1 and shifts[0] is not None:
        dx, dy = shifts[0]
        pushed = replace(pose, x_um=pose.x_um + dx, y_um=pose.y_um + dy)
        return pushed, math.hypot(dx, dy)
    if all(shift == (0.0, 0.0) for shift in shifts):
        return pose, 0.0
    holes = [body.holes[hole].ring for _, _, hole in threaded]
    pegs = [
        moved(post.ring.corners_um, _relative(truth, body, host))
        for host, post, _ in threaded
    ]
    pairs = [(ring.corners_um, peg) for ring, peg in zip(holes, pegs, strict=True)]
    middle = np.mean([ring.center_um for ring in holes], axis=0)
    center = (float(middle[0]), float(middle[1]))
    reach_um = math.sqrt(float(((body.edge - middle) ** 2).sum(axis=1).mean()))
    motion = smallest_motion(pairs, center, reach_um)
    if motion is None:
        return None
    shift_um = math.dist(motion.apply(*center), center)
    push_um = math.hypot(shift_um, reach_um * motion.theta_rad)
    return pose.compose(motion.inverse()), push_um


def _shift(
    truth: Truth, body: TrueBody, threaded: _Threaded
) -> tuple[float, float] | None:
    """Return the shift that a post alone asks for; None if that takes its outline."""
    host, post, number = threaded
    hole = body.holes[number].ring
    x, y = truth.pose(body).apply(*hole.center_um)
    px, py = truth.pose(host).apply(*post.ring.center_um)
    off_um = math.hypot(x - px, y - py)
    if decided(hole, post.ring, off_um):
        return (0.0, 0.0)
    if hole.round_um is None or post.ring.round_um is None:
        return (0.0, 0.0) if _is_over(truth, body, number, host, post) else None
    push_um = off_um - max(hole.round_um - post.ring.round_um, 0.0)
    share = push_um / off_um if off_um > 0 else 0.0
    return (share * (px - x), share * (py - y))


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
        if _overlap(truth, body, other):
            yield truth.top_um(other), name


def _drop_if_lost(truth: Truth, body: TrueBody) -> None:
    """Let go of a part that was lifted out of the jaws."""
    tool = truth.tool
    if tool is not None and body.z_um >= tool.thickness_um:
        truth.held = ""
        drop(truth, body)


def drop(truth: Truth, body: TrueBody) -> None:
    """Put a free part onto what is under it."""
    lean(truth, body)
    under_um = truth.under_um(body)
    floors = [z for z, _ in _floors(truth, body) if z <= under_um + FROM_ABOVE_UM]
    for host, post in posts(truth):
        if host is body or post.name in body.on_posts:
            continue
        top_um = truth.post_top_um(host, post)
        if top_um > under_um + FROM_ABOVE_UM:
            continue
        resting = abs(top_um - under_um) < 1e-6  # it already lies on this post
        hole = hole_over(truth, body, host, post)
        if hole is not None and not resting:
            body.on_posts[post.name] = hole
        elif hole is not None or _post_under(truth, body, host, post):
            floors.append(top_um)
    truth.carry(body, "stage", truth.pose(body), max(floors, default=under_um))


def _post_under(truth: Truth, body: TrueBody, host: TrueBody, post: TruePost) -> bool:
    """Return whether a post that is not in a hole lies under the body's material."""
    at = _relative(truth, body, host)
    if math.hypot(*at.apply(*post.ring.center_um)) > body.reach_um + post.ring.outer_um:
        return False
    ask = partial(meets, body.rings, post.ring, post.rings)
    return _answer(body, (post.name, MATERIAL), post, at, ask)


def _overlap(truth: Truth, body: TrueBody, other: TrueBody) -> bool:
    """Return whether the outlines of two bodies share any area."""
    at = _relative(truth, body, other)
    if math.hypot(at.x_um, at.y_um) > body.reach_um + other.reach_um:
        return False
    return share_area([moved(ring, at) for ring in other.rings], body.rings)
