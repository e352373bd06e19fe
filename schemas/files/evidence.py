"""Evidence of a plan for reports: trials of looks, poses of bodies.

Exports and reports alone read it; a run works with it deleted. Lengths are um, angles
rad. Outlines are in the world's file, under the same names.
"""

from __future__ import annotations

from collections.abc import Mapping
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


FOLDER = "evidence"


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureMark:
    """Where a feature that a look measures should be, and what it is."""

    name: str
    kind: str  # of target
    pose: Pose  # of its frame in the world
    z_um: float
    parameters: Mapping[str, float]  # as a routine's target has them
    body: str = ""  # whose edges they are; "": the owner's


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRecord:
    """One trial of the chain that was chosen."""

    trial: int
    focus_um: float  # error of the focus
    magnification: float  # ratio to nominal
    error_um: float | None  # None: no answer
    failure: str  # code; "" where it answered
    wrong: bool  # it answered, but falsely


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """An image of the look's region, from the trials."""

    what: str  # focus, magnification or worst
    value: float  # error of the focus, or ratio of the zoom; the trial's number
    image: str  # path in the plan folder


@dataclass(frozen=True, slots=True, kw_only=True)
class LookEvidence:
    """What a report shows of a look in addition to the plan."""

    look: str
    places: Mapping[str, Pose]  # part or tool -> where it is while looking, world
    opening_um: float | None  # of the jaws
    features: tuple[FeatureMark, ...]  # as measured, the target first
    trials: tuple[TrialRecord, ...]
    shown: tuple[Shown, ...]
