"""What stands where at each look of a plan: bodies by name, in nominal poses.

Only exports and reports read it; a run works with it deleted. Outlines are in the
world's file, under the same names.
"""

from __future__ import annotations

from dataclasses import dataclass

from microplan.schemas.plan import AxisMove
from microplan.schemas.pose import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedBody:
    """A body at its nominal pose."""

    name: str  # part, part.post, or a finger: tool.left, tool.right
    pose: Pose  # of the frame that its outline is given in
    z_um: float  # world height of its top face


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenTarget:
    """Which edges a look is at."""

    name: str  # as measured
    pose: Pose  # its frame in the world: reference point and nominal angle
    bodies: tuple[str, ...]  # whose edges they are
    ring: int | None  # of the one body's outline; None: all


@dataclass(frozen=True, slots=True, kw_only=True)
class LookScene:
    """The assembly at one look."""

    look: str
    target: SeenTarget
    stage: AxisMove  # readings of all axes
    robot: AxisMove | None  # None without a tool
    opening_um: float | None
    bodies: tuple[PlacedBody, ...]  # in view or not, by height


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenes:
    """All looks of a plan, in its order."""

    looks: tuple[LookScene, ...]
