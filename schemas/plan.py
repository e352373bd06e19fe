"""The augmented plan: frozen types shared by compiler, diff and executor.

Lengths are um in the world (camera) frame and angles rad unless a name says otherwise;
`docs/conventions.md` defines frames and signs. `plan.json` is `to_data` of `Plan`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from schemas import version
from schemas.codec import CodecError, from_data, to_data
from schemas.pose import Pose
from schemas.solids import Fingers, Solid
from schemas.verdicts import (
    BudgetAnalysis,
    FitVerdict,
    GraspVerdict,
    MethodChoice,
    PlacingVerdict,
    ReleaseVerdict,
)
from schemas.views import CoarseFirst, ViewVerdict

FORMAT_VERSION = "2.3"

AxesName = Literal["stage", "robot"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisMove:
    """Absolute targets of one axis group, moved together; None leaves an axis."""

    axes: AxesName
    x_um: float | None = None
    y_um: float | None = None
    z_um: float | None = None
    theta_rad: float | None = None
    speed_um_per_s: float | None = None  # None: the axes' own speed


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """The part of the frame a routine sees, px; (0, 0) is the frame's top left."""

    row: int
    column: int
    rows: int
    columns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """How the microscope is set for a look."""

    magnification: float
    focus_um: float  # world height of the plane in focus
    focus_stops_um: tuple[float, ...]  # tried in turn where nothing is found at first
    light: float  # level of the light [1]
    field_um: tuple[float, float]  # width, height
    um_per_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerRecord:
    """One body the camera sees."""

    name: str
    z_um: float
    reflectance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Shade:
    """How much of a target's edges a higher body covers or shades, 0..1 each."""

    target: str
    by: str
    hidden: float
    shaded: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneRecord:
    """What is in view, and the reference image of it."""

    layers: tuple[LayerRecord, ...]
    shades: tuple[Shade, ...]
    image: str  # path in the plan folder
    image_sha256: str  # of the decoded pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectRow:
    """One effect, how it is treated, and what leaving the rest out costs."""

    effect: str
    level: str
    predicted_error: float | None
    limit: float | None
    unit: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RoutineUse:
    """One routine of a chain, with what `measure` needs."""

    id: str
    version: str
    parameters: Mapping[str, float]
    arrays: str | None  # npz in the plan folder


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Where the target should be if everything were nominal."""

    column: float  # px of the region
    row: float
    pose: Pose  # world
    z_um: float  # world height of the target's face


@dataclass(frozen=True, slots=True, kw_only=True)
class Gates:
    """What a measurement must meet to be accepted."""

    min_score: float
    max_shift_um: float  # from the expected place
    max_turn_rad: float | None  # from the expected angle; None: any angle
    max_spread_um: float | None = None  # of the routine's own sigma; None: any


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasAt:
    """Mean error that the renderer predicts at one focus, in the target's frame."""

    dz_um: float  # of the focus from the look's own
    bias_x_um: float
    bias_y_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Depth:
    """What the usable focus range of a feature stands beside."""

    textbook_um: float  # depth of field n wavelength / A**2, from end to end
    spurious_um: float | None  # defocus that turns dark and bright about; None: none
    contrast: tuple[float, float]  # at both ends of the range, over that in focus


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """How a look measures one feature: its target, or another of the same part."""

    chain: tuple[RoutineUse, ...]  # coarse to fine
    fallback: tuple[RoutineUse, ...]  # used when the chain fails aloud; may be empty
    region: Region
    reference: Reference
    bias_um: tuple[float, float]  # mean error, in the target's frame; subtract it
    # rows column, row (down); columns x, y per um, theta per rad, relative zoom
    jacobian_px_per_um: tuple[tuple[float, ...], ...]
    sigma_xy_um: float  # per axis, from the trials
    sigma_theta_rad: float | None  # None: the angle is not measured
    limit_xy_um: float | None  # Cramer-Rao bound per axis; None: not computed
    gates: Gates
    capture_um: float  # how far the target may be from the nominal place
    symmetry: int
    symmetry_broken_by: str  # "" if nothing does, or nothing needs to
    usable_focus_um: tuple[float, float]  # focus error that still meets the tolerance
    usable_magnification: tuple[float, float]  # ratio to nominal that still does
    fallback_bias_um: tuple[float, float] = (0.0, 0.0)  # as bias_um, of the fallback
    fallback_sigma_xy_um: float | None = None  # as sigma_xy_um, of the fallback
    fallback_sigma_theta_rad: float | None = None
    fallback_min_score: float = 0.0  # as gates.min_score, of the fallback
    feature: str = ""  # what is measured; "": the look's target
    offset_um: tuple[float, float] = (0.0, 0.0)  # from the target, in the part's frame
    turn_rad: float = 0.0  # of the feature's frame in the part's
    bias_through_focus: tuple[BiasAt, ...] = ()  # by rising dz_um; () = not predicted
    depth: Depth | None = None  # None: not computed


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """What the trials said of one chain."""

    chain: tuple[str, ...]
    trials: int
    success: int
    success_lower: float  # one-sided 95 %, Clopper-Pearson
    silent: int  # answered, but wrong
    silent_upper: float  # one-sided 95 %, Clopper-Pearson
    bias_um: tuple[float, float] | None  # None: no success to measure it on
    sigma_um: float | None  # per axis
    worst_um: float | None
    sigma_theta_rad: float | None
    cost: float  # deterministic, in 640 x 480 box filters
    reason: str  # why it was chosen, kept as fallback, or rejected
    sigma_upper_um: float | None = None  # of the larger axis, one-sided 95 %
    ratio_to_limit: float | None = None  # rms, bias included, over `limit_xy_um`
    worst_trial: int | None = (
        None  # of the answers; `microplan render --trial` shows it
    )
    median_trial: int | None = None
    first_failing_trial: int | None = None  # aloud or silently


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureRow:
    """One feature, or the set that is used, by Feddema's criteria.

    `docs/features.md` says how each is computed; None where it was not.
    """

    name: str  # features of a set joined by " + "
    kind: str  # of target; "set"
    reason: str  # why it is used or not
    chain: tuple[str, ...] = ()  # the best one, () if none was tried
    robustness: float | None = None
    uniqueness: float | None = None
    completeness: float | None = None
    cost: float | None = None
    resolution_um: float | None = None
    rank: int | None = None
    controllability: float | None = None
    conditioning: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """The trials behind a look's choice; `scores` hold every chain tried."""

    tolerance_um: float  # what the look had to meet
    chosen: Score
    others: tuple[Score, ...]
    features: tuple[FeatureRow, ...] = ()  # the part's, tried or not


@dataclass(frozen=True, slots=True, kw_only=True)
class Together:
    """What several features of one look tell, measured on the same frame."""

    sigma_xy_um: float  # of the target's place, in the direction known worst
    sigma_theta_rad: float | None  # None: the angle is not told
    conditioning: float  # of the Jacobian, rotation scaled by the part's radius
    dropped_um: float | None  # sigma without the worst feature; None: not told then
    least: int  # features that must answer
    success_lower: float  # of fresh trials of the set, as in `Score`
    silent_upper: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """One measurement of one target through the microscope."""

    id: str
    target: str  # part, part.feature, part.post, tool.grip
    view: View
    scene: SceneRecord
    effects: tuple[EffectRow, ...]
    measure: Measure
    evidence: Evidence
    others: tuple[Measure, ...] = ()  # further features, measured on the same frame
    together: Together | None = None  # None: `measure` alone tells the pose
    verdict: ViewVerdict | None = None  # None: unknown
    coarse: CoarseFirst | None = None  # None: nothing comes before

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Return how each feature of the look is measured, the first first."""
        return (self.measure, *self.others)

    @property
    def sigma_xy_um(self) -> float:
        """Return the spread of the target's place per axis, from the trials."""
        if self.together is None:
            return self.measure.sigma_xy_um
        return self.together.sigma_xy_um

    @property
    def sigma_theta_rad(self) -> float | None:
        """Return the spread of the target's angle, None if it is not measured."""
        if self.together is None:
            return self.measure.sigma_theta_rad
        return self.together.sigma_theta_rad


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightSearch:
    """Focus sweep over a face: where its image is sharpest is its height."""

    look: str  # id of the look whose view and region it uses
    expected_um: float
    within_um: float
    focus_um: tuple[float, ...]  # stops
    ring_radius_um: float  # the score is taken on edges about this radius; 0: all


@dataclass(frozen=True, slots=True, kw_only=True)
class LocateAction:
    """Measure `target` and remember where it is."""

    kind: Literal["locate"] = "locate"
    target: str
    look: str


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignAction:
    """Move `axes` until `target` is at `to`, looking after every move."""

    kind: Literal["align"] = "align"
    target: str
    to: str
    look: str
    axes: AxesName
    path: tuple[
        str, ...
    ]  # order of the first approach: ("xy",), ("x", "y"), ("y", "x")


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspAction:
    """Close the jaws of `tool` on `target`."""

    kind: Literal["grasp"] = "grasp"
    target: str
    tool: str
    opening_um: float
    across_um: float = 0.0  # of the part's origin, from the middle of the closed jaws


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveAction:
    """Nothing beyond the step's moves."""

    kind: Literal["move"] = "move"


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertAction:
    """Put `target` onto `onto` by `moves`; no sensor tells whether it seated."""

    kind: Literal["insert"] = "insert"
    target: str
    onto: str
    moves: tuple[AxisMove, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReleaseAction:
    """Open the jaws of `tool`."""

    kind: Literal["release"] = "release"
    target: str
    tool: str
    opening_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class VerifyAction:
    """Decide whether `target` sits on `on`; every part of it can fail."""

    kind: Literal["verify"] = "verify"
    target: str
    on: str
    look: str  # sees the target
    seat_look: str  # sees what it should sit on
    within_um: float
    height: HeightSearch | None
    empty: str | None  # tool that must hold nothing
    within_rad: float | None = None  # turned against the seat; None: any angle


Action = (
    LocateAction
    | AlignAction
    | GraspAction
    | MoveAction
    | InsertAction
    | ReleaseAction
    | VerifyAction
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """How a step servoes."""

    method: Literal["servo", "look_then_move"]
    gain: float
    gain_limit: float  # stable below this for the stated latency
    tolerance_xy_um: float
    tolerance_theta_rad: float | None
    max_step_um: float  # a larger correction after the first approach is a fault
    max_cycles: int
    expected_cycles: float
    expected_s: float  # looks and settling, after the first approach
    approach_s: float = 0.0  # the first approach, zoom and focus set
    floor_s: float | None = None  # moves, settling and exposures alone
    ratio_to_floor: float | None = None  # of approach_s + expected_s
    choice: MethodChoice | None = None
    # a corrected target lands so near, per axis: what a look after it starts from;
    # None: not known, every look searches anew
    move_sigma_um: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class OnFailure:
    """What the executor does when a step fails with `code`."""

    code: str
    do: Literal["retry", "fallback", "stop"]
    times: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """What sensors can test before and after, and the safe way out."""

    before: tuple[str, ...]
    after: tuple[str, ...]
    retreat: tuple[AxisMove, ...]
    on_failure: tuple[OnFailure, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetRow:
    """One error term of a mechanical action, one sigma per axis."""

    term: str
    sigma_um: float | None  # None: not modelled
    source: str
    along_rad: float | None = None  # world; None: alike in every direction


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """The error terms of one step and what they leave of its success."""

    rows: tuple[BudgetRow, ...]
    limit_um: float | None  # capture radius, or the step's tolerance
    success_probability: float
    advice: str  # the cheapest change that would pass; "" if it passes
    analysis: BudgetAnalysis | None = None  # of an insertion or a placement


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step, ready to run: moves, then looks and action."""

    id: str
    verb: str
    key: str  # sha256 over the content and the previous step's key
    physical: bool
    irreversible: bool
    moves: tuple[AxisMove, ...]
    looks: tuple[Look, ...]
    action: Action
    control: Control | None
    conditions: Conditions
    budget: Budget
    fit: FitVerdict | None = None  # of an insertion
    grasp: GraspVerdict | None = None  # of a grasp
    release: ReleaseVerdict | None = None  # of a release
    placing: PlacingVerdict | None = None  # of a release that a verify step checks
    effects: tuple[EffectRow, ...] = ()  # mechanical; a look's are its own


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """Where something is thought to be before step 1, in its carrier's frame.

    The stage's frame is the world at stage reading 0; the robot's is its grip.
    """

    name: str  # part or tool
    carrier: AxesName
    pose: Pose
    sigma_xy_um: float
    sigma_theta_rad: float  # pi: any
    z_um: float = 0.0  # world height of the underside, its carrier's z reading at 0


@dataclass(frozen=True, slots=True, kw_only=True)
class FeaturePlace:
    """Where a named feature sits in its owner's frame."""

    name: str  # "gear.bore"
    owner: str  # "gear"
    x_um: float
    y_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirements:
    """What the station must offer; preflight compares."""

    width_px: int
    height_px: int
    pitch_um: float
    bits: int
    magnification: tuple[float, float]
    focus_um: tuple[float, float]
    opening_um: tuple[float, float]
    travel: Mapping[str, tuple[float, float]]  # "stage.x_um" -> least, most
    theta_axis_um: tuple[float, float]  # world point the stage turns about at reading 0
    # one sigma per axis of where "stage" and "robot" land; None: not told
    repeatability_um: Mapping[str, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Why a plan is infeasible."""

    code: str
    step: str
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What the plan was made from; hashes are of the normalised inputs."""

    microplan: str
    task_sha256: str
    workcell_sha256: str
    drawings_sha256: Mapping[str, str]
    seed: int
    preset: str
    max_image_error: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The augmented plan."""

    format_version: str
    name: str
    status: Literal["feasible", "infeasible"]
    reasons: tuple[Reason, ...]
    provenance: Provenance
    requirements: Requirements
    beliefs: tuple[Belief, ...]
    features: tuple[FeaturePlace, ...]
    stage_start: AxisMove
    robot_start: AxisMove | None
    opening_start_um: float | None
    success_probability: float
    success_goal: float | None
    steps: tuple[Step, ...]
    parts: tuple[Solid, ...] = ()  # the room they take up; (): not told
    fingers: tuple[Fingers, ...] = ()


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
