"""Which hole goes over which post: one outline inside another one, at a pose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.simulated.outlines.crossing import (
    cross,
    distances_um,
    enclosed,
    moved,
    segments,
    share_area,
)
from microplan.executor.simulated.outlines.fabricated import FabricatedRing
from microplan.schemas.pose import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseAnswer:
    """An answer about a post at a pose, and how far it holds about it."""

    yes: bool
    at: Pose  # of the post's part in the frame of the other part
    room_um: float  # no motion of the post's points below this changes the answer

    def holds_at(self, post: FabricatedRing, at: Pose) -> bool:
        """Return whether a post at another pose is known to have the same answer."""
        was = self.at.apply(*post.center_um)
        shift_um = math.dist(was, at.apply(*post.center_um))
        turn_rad = abs(math.remainder(at.theta_rad - self.at.theta_rad, math.tau))
        return shift_um + post.outer_um * turn_rad < self.room_um


def over(hole: FabricatedRing, post: FabricatedRing, at: Pose) -> PoseAnswer:
    """Return whether a hole goes over a post, see `goes_over`, and how clearly."""
    yes = goes_over(hole, post, at)
    corners = moved(post.corners_um, at)
    if yes:
        room_um = min(
            float(distances_um(corners, hole.corners_um).min()),
            float(distances_um(hole.corners_um, corners).min()),
        )
    else:
        out = corners[~enclosed(corners, hole.corners_um)]
        room_um = float(distances_um(out, hole.corners_um).max(initial=0.0))
    return PoseAnswer(yes=yes, at=at, room_um=room_um)


def meets(
    rings: Sequence[FloatArray],
    post: FabricatedRing,
    outlines: Sequence[FloatArray],
    at: Pose,
) -> PoseAnswer:
    """Return whether a post shares area with a region, and how clearly if it does.

    Parameters
    ----------
    rings : sequence of (N, 2) float arrays
        Of the region: outer ones and holes, um, in its part's frame.
    post : FabricatedRing
        Outermost ring of the post.
    outlines : sequence of (N, 2) float arrays
        All rings of the post, um, in its part's frame.
    at : Pose
        Of the post's part in the frame of the region's.
    """
    if not share_area([moved(ring, at) for ring in outlines], rings):
        return PoseAnswer(yes=False, at=at, room_um=0.0)
    corners = moved(post.corners_um, at)
    depth = sum(enclosed(corners, ring).astype(int) for ring in rings)
    within = corners[np.asarray(depth) % 2 == 1]
    far = np.min([distances_um(within, ring) for ring in rings], axis=0)
    return PoseAnswer(yes=True, at=at, room_um=float(far.max(initial=0.0)))


def goes_over(hole: FabricatedRing, post: FabricatedRing, at: Pose) -> bool:
    """Return whether a hole goes over a post: the post lies wholly inside the hole.

    Whole circles are compared by radii. Anything else is compared as polygons that err
    to the safe side by at most twice SAGITTA_UM.

    Parameters
    ----------
    hole, post : FabricatedRing
        Each in its own part's frame.
    at : Pose
        Of the post's part in the frame of the hole's.
    """
    known = decided(hole, post, math.dist(at.apply(*post.center_um), hole.center_um))
    if known is not None:
        return known
    return inside(hole.corners_um, moved(post.corners_um, at))


def decided(hole: FabricatedRing, post: FabricatedRing, off_um: float) -> bool | None:
    """Return what the distance of the centres tells alone; None if it does not."""
    if hole.round_um is not None and post.round_um is not None:
        return off_um < hole.round_um - post.round_um
    if off_um + post.outer_um < hole.inner_um:
        return True
    if off_um + post.inner_um > hole.outer_um:
        return False
    return None


def inside(hole: FloatArray, post: FloatArray) -> bool:
    """Return whether a (N, 2) um polygon lies wholly inside a (M, 2) um one."""
    return bool(enclosed(post[:1], hole)[0]) and not cross(
        segments(post), segments(hole)
    )
