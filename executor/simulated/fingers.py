"""Collisions of the fingers with parts, posts and the stage."""

from __future__ import annotations

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.simulated.shapes import inside, moved
from microplan.executor.simulated.truth import Truth
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
