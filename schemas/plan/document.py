"""The plan document: provenance, needs, beliefs, steps, as JSON text."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from microplan.schemas import version
from microplan.schemas.codec import CodecError, from_data, to_data
from microplan.schemas.plan.actions import AxesName, AxisMove
from microplan.schemas.plan.bounds import SuccessBound
from microplan.schemas.plan.looks import SketchedLook
from microplan.schemas.plan.steps import Step
from microplan.schemas.plan.views import Fingers, Solid
from microplan.schemas.pose import Pose


def dump_plan(plan: Plan) -> str:
    """Return the plan as JSON: two-space indent, LF, a final newline."""
    return json.dumps(to_data(plan), indent=2, ensure_ascii=False) + "\n"


def parse_plan(text: str) -> Plan:
    """Return the plan that `text` holds.

    Raises
    ------
    CodecError
        If it is not JSON, of a newer major version, or does not fit the types.
    """
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise CodecError(f"not JSON: {error}") from error
    check_version(data)
    return from_data(Plan, data)


def newer_note(plan: Plan) -> str:
    """Return that a plan is of a newer minor version than its reader, "" if not."""
    if not version.is_newer(plan.format_version, FORMAT_VERSION):
        return ""
    return (
        f"the plan is of format {plan.format_version}, this microplan knows "
        f"{FORMAT_VERSION}: what is new in it is passed over"
    )


def check_version(data: Any) -> None:
    """Raise CodecError unless `data` are of a version this reader understands."""
    stated = data.get("format_version") if isinstance(data, dict) else None
    try:
        version.check(stated, FORMAT_VERSION)
    except version.VersionError as error:
        raise CodecError(f"format_version {error}") from error


SKETCH: Final = "sketch"  # the preset, and the status if nothing is against it
FORMAT_VERSION = "2.9"


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """Where something is thought to be before step 1, in its carrier's frame.

    The stage's frame is the world at stage reading 0; the robot's is its grip.
    """

    name: str  # part or tool
    carrier: AxesName  # what it stands on or is held by
    pose: Pose  # in the carrier's frame
    sigma_xy_um: float  # per axis
    sigma_theta_rad: float  # pi: any
    z_um: float = 0.0  # world height of the underside, its carrier's z reading at 0


@dataclass(frozen=True, slots=True, kw_only=True)
class FeaturePlace:
    """Where a named feature sits in its owner's frame."""

    name: str  # "gear.bore"
    owner: str  # "gear"
    x_um: float  # of its centre
    y_um: float  # of its centre


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirements:
    """What the station must offer; preflight compares."""

    width_px: int  # of the camera's frame
    height_px: int  # of the camera's frame
    pitch_um: float  # of the sensor's pixels
    bits: int  # of a pixel
    magnification: tuple[float, float]  # least and most that looks use
    focus_um: tuple[float, float]  # least and most that looks use
    opening_um: tuple[float, float]  # least and most that the jaws need
    travel: Mapping[str, tuple[float, float]]  # "stage.x_um" -> least, most
    theta_axis_um: tuple[float, float]  # world point the stage turns about at reading 0
    # one sigma per axis of where "stage" and "robot" land; None: not told
    repeatability_um: Mapping[str, float] | None = None
    # Added after 2.6. Share of full scale of the light and the count it gives, rising;
    # (): in proportion, full scale at the top count.
    response: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        for values in zip(*self.response, strict=True):
            rises = all(a < b for a, b in itertools.pairwise(values))
            if len(values) < 2 or not rises or not math.isfinite(values[-1]):
                raise ValueError(f"response must rise, 2 rows or more, got {values}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Why a plan is infeasible."""

    code: str  # of the finding
    step: str  # id of the step it is about
    message: str  # as the compiler said it


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What the plan was made from; hashes are of the normalised inputs."""

    microplan: str  # version of the compiler
    task_sha256: str  # of the task
    workcell_sha256: str  # of the workcell
    drawings_sha256: Mapping[str, str]  # by part or tool
    seed: int  # of the task
    preset: str  # how much was spent
    max_image_error: float  # of unit contrast


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The augmented plan."""

    format_version: str  # major.minor
    name: str  # of the task
    # the executor runs a feasible plan alone; a sketch, added after 2.8, has no trials
    status: Literal["feasible", "infeasible", "sketch"]
    reasons: tuple[Reason, ...]  # why it is infeasible; () if it is not
    provenance: Provenance  # what it was made from
    requirements: Requirements  # what the station must offer
    beliefs: tuple[Belief, ...]  # where things are before step 1
    features: tuple[FeaturePlace, ...]  # places of named features
    stage_start: AxisMove  # readings before step 1
    robot_start: AxisMove | None  # readings before step 1; None: no robot
    opening_start_um: float | None  # of the jaws before step 1; None: no tool
    success_probability: float  # of the whole run; 0: not worked out
    success_goal: float | None  # what the task asks for; None: nothing
    steps: tuple[Step, ...]  # in order
    parts: tuple[Solid, ...] = ()  # the room they take up; (): not told
    fingers: tuple[Fingers, ...] = ()  # of the tool; (): not told
    # Added after 2.3. Lower bound of success_probability; None: unknown.
    success_bound: SuccessBound | None = None
    # of a sketch, which has no steps. Added after 2.8
    sketched: tuple[SketchedLook, ...] = ()

    @property
    def is_sketch(self) -> bool:
        """Return whether nothing was tried, feasible or not."""
        return self.provenance.preset == SKETCH
