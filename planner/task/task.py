"""The task: parts, start, goal, steps, as the file describes them.

Angles are radians here; the reader converts degrees once. Every named thing carries the
position in the file where it was declared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from microplan.optics.outline.outline import Outline
from microplan.planner.source.diagnostics import Span
from microplan.planner.task.drawings import DrawingSheet
from microplan.planner.task.finishes import SurfaceFinish
from microplan.planner.task.presets import PRESETS, Preset
from microplan.planner.task.workcell import Interval, Workcell

FeatureKind = Literal["circle", "teeth", "notch", "outline"]
Verb = Literal["locate", "align", "grasp", "move", "insert", "release", "verify"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PartFeature:
    """A named feature of a part; lengths in um in the part's frame."""

    name: str
    kind: FeatureKind
    center_um: tuple[float, float]
    # circle: its radius; teeth: outer radius; notch: of its middle, about the circle's
    # centre, which is `center_um`; outline: of the circle about `center_um` around it
    radius_um: float
    layer: str = ""  # of the drawing that its rings are on; "": any
    on: str = ""  # the post or mark whose edges it has; "": the part's own
    region: bool = False  # outline: of a ring, not of the whole part
    ring: int | None = None  # region: which of its outline's rings; None: all
    symmetry: int = 1  # region: order of its rotational symmetry, 0: round
    count: int = 1  # teeth: how many
    root_um: float = 0.0  # teeth: root radius
    phase_rad: float = 0.0  # of the middle of a tooth or notch
    width_um: float = 0.0  # notch: its width
    hole: bool = False  # circle: whether it bounds a hole
    chord_um: float = 0.0  # circle: how far the edges drawn for it run inside
    avoid: bool
    where: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Post:
    """A prism on a part's top face."""

    name: str
    outline: Outline
    height_um: float
    reflectance: float
    surface: SurfaceFinish
    profile_tolerance_um: float
    center_um: tuple[float, float]
    radius_um: float  # of the circle that it is, or of the one around it
    symmetry: int = 0  # order of its rotational symmetry, 0: a circle
    where: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class FaceMark:
    """What is flat on the top face of a part or post: a coating, a pad, a fiducial."""

    name: str  # "cross", or "post.cross" of one on a post
    on: str  # the post that carries it; "": the part
    outline: Outline  # separate pads are rings of one
    reflectance: float
    finish: tuple[float, float] | None = None  # None: not stated
    transmittance: float = 0.0
    where: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """An outline times a height, in the frame of its origin."""

    name: str
    outline: Outline
    thickness_um: float
    reflectance: float
    surface: SurfaceFinish
    material: str
    profile_tolerance_um: float  # hard limit of the drawn-to-made edge offset
    taper_um_per_100um: float
    features: Mapping[str, PartFeature]
    posts: Mapping[str, Post]
    marks: Mapping[str, FaceMark] = field(default_factory=dict)
    chord_um: float  # farthest that chords in its drawing miss a curve, 0 if none
    sheet: DrawingSheet
    where: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class StartPose:
    """Where a part lies before step 1, on the stage at reading 0."""

    name: str
    x_um: float
    y_um: float
    theta_rad: float
    theta_any: bool
    sigma_xy_um: float
    sigma_theta_rad: float
    face: Literal["up", "down"]
    where: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolStart:
    """The robot's reading and the jaws' opening before step 1."""

    name: str
    x_um: float
    y_um: float
    z_um: float
    theta_rad: float
    opening_um: float
    where: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Absolute targets of one axis group; None leaves an axis where it is."""

    x_um: float | None = None
    y_um: float | None = None
    z_um: float | None = None
    theta_rad: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """One entry of a `move` list."""

    axes: Literal["stage", "robot"]
    to: Reading
    where: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskStep:
    """One step of the task; keys that a verb does not read are None."""

    id: str
    verb: Verb
    target: str | None = None  # X: part, part.feature, part.post or tool
    to: str | None = None  # align
    tool: str | None = None  # grasp
    onto: str | None = None  # insert
    on: str | None = None  # verify: seat
    empty: str | None = None  # verify: tool
    view_um: tuple[float, float] | None = None
    move: tuple[Move, ...] = ()
    opening_um: float | None = None
    method: Literal["auto", "servo", "look_then_move"] = "auto"
    tolerance_xy_um: float | None = None
    tolerance_theta_rad: float | None = None
    within_um: float | None = None
    within_rad: float | None = None  # verify: largest rotation against its seat
    height_within_um: float | None = None
    speed_um_per_s: float | None = None
    if_blocked: bool = False  # insert: it states what to do when blocked
    where: Span
    spans: Mapping[str, Span]  # key -> position of its value


@dataclass(frozen=True, slots=True, kw_only=True)
class Optimise:
    """What the compiler may trade."""

    prefer: Preset = "balanced"
    max_image_error: float | None = None  # of unit contrast; None: the preset's

    def image_error(self, preset: Preset | None = None) -> float:
        """Return what images may err by: as stated, else as the preset has it."""
        stated = self.max_image_error
        return PRESETS[preset or self.prefer].image_error if stated is None else stated


@dataclass(frozen=True, slots=True, kw_only=True)
class Benchmark:
    """What the synthetic images are perturbed by; one sigma, or an interval."""

    focus_sigma_um: float = 4.0
    magnification_sigma: float = 0.005
    light_gain: Interval = (0.7, 1.3)
    light_gradient: Interval = (0.0, 0.3)
    pose_sigma_xy_um: float = 2.0
    pose_sigma_theta_rad: float = 0.08726646259971647


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """What surfaces stick and rub by; read where adhesion or friction matters."""

    humidity: float = 0.4  # relative, 0..1
    grounded: bool = True
    roughness_um: float = 0.02  # of the surfaces that touch, rms
    friction: float = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Everything a task file says, with the workcell it names."""

    name: str
    seed: int
    workcell: Workcell
    parts: Mapping[str, Part]
    stage_start: Reading
    part_starts: Mapping[str, StartPose]
    tool_starts: Mapping[str, ToolStart]
    success_goal: float | None
    steps: tuple[TaskStep, ...]
    optimise: Optimise
    benchmark: Benchmark
    environment: Environment
    where: Mapping[str, Span]  # "start", "goal", "steps", ...
    normalised: Mapping[str, object]  # plain data, defaults filled in, for hashing
