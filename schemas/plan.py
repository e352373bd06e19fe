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

    axes: AxesName  # which group moves
    x_um: float | None = None  # reading to go to
    y_um: float | None = None  # reading to go to
    z_um: float | None = None  # reading to go to
    theta_rad: float | None = None  # reading to go to
    speed_um_per_s: float | None = None  # None: the axes' own speed


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """The part of the frame a routine sees, px; (0, 0) is the frame's top left."""

    row: int  # of the top left pixel, in the frame
    column: int  # of the top left pixel, in the frame
    rows: int  # height of the region
    columns: int  # width of the region


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """How the microscope is set for a look."""

    magnification: float  # zoom that is set
    focus_um: float  # world height of the plane in focus
    focus_stops_um: tuple[float, ...]  # tried in turn where nothing is found at first
    light: float  # level of the light [1]
    field_um: tuple[float, float]  # width, height
    um_per_px: float  # in object space


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerRecord:
    """One body the camera sees."""

    name: str  # part, post, or finger
    z_um: float  # world height of its top face
    reflectance: float  # of its top face


@dataclass(frozen=True, slots=True, kw_only=True)
class Shade:
    """How much of a target's edges a higher body covers or shades, 0..1 each."""

    target: str  # part whose edges are counted
    by: str  # the higher body
    hidden: float  # share of the edges that it covers
    shaded: float  # share of the edges that it shades


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneRecord:
    """What is in view, and the reference image of it."""

    layers: tuple[LayerRecord, ...]  # bodies in view, by rising height
    shades: tuple[Shade, ...]  # what covers or shades what
    image: str  # path in the plan folder
    image_sha256: str  # of the decoded pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectRow:
    """One effect, how it is treated, and what leaving the rest out costs."""

    effect: str  # what is modelled or left out
    level: str  # how far it is modelled
    predicted_error: float | None  # of leaving the rest out; None: not known
    limit: float | None  # what it may cost; None: none is set
    unit: str  # of error and limit
    reason: str  # why this level


@dataclass(frozen=True, slots=True, kw_only=True)
class RoutineUse:
    """One routine of a chain, with what `measure` needs."""

    id: str  # name of the routine
    version: str  # must be the executor's
    parameters: Mapping[str, float]  # numbers that it works with
    arrays: str | None  # npz in the plan folder


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Where the target should be if everything were nominal."""

    column: float  # px of the region
    row: float  # px of the region, down
    pose: Pose  # world
    z_um: float  # world height of the target's face


@dataclass(frozen=True, slots=True, kw_only=True)
class Gates:
    """What a measurement must meet to be accepted."""

    min_score: float  # score below which an answer is refused
    max_shift_um: float  # from the expected place
    max_turn_rad: float | None  # from the expected angle; None: any angle
    max_spread_um: float | None = None  # of the routine's own sigma; None: any


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasAt:
    """Mean error that the renderer predicts at one focus, in the target's frame."""

    dz_um: float  # of the focus from the look's own
    bias_x_um: float  # along x of the target
    bias_y_um: float  # along y of the target


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
    region: Region  # what the routine sees of the frame
    reference: Reference  # where the target should be
    bias_um: tuple[float, float]  # mean error, in the target's frame; subtract it
    # rows column, row (down); columns x, y per um, theta per rad, relative zoom
    jacobian_px_per_um: tuple[tuple[float, ...], ...]
    sigma_xy_um: float  # per axis, from the trials
    sigma_theta_rad: float | None  # None: the angle is not measured
    limit_xy_um: float | None  # Cramer-Rao bound per axis; None: not computed
    gates: Gates  # what an answer must meet
    capture_um: float  # how far the target may be from the nominal place
    symmetry: int  # order of the rotational one; 1: none; 0: any turn
    symmetry_broken_by: str  # "" if nothing does, or nothing needs to
    usable_focus_um: tuple[float, float]  # focus error that still meets the tolerance
    usable_magnification: tuple[float, float]  # ratio to nominal that still does
    fallback_bias_um: tuple[float, float] = (0.0, 0.0)  # as bias_um, of the fallback
    fallback_sigma_xy_um: float | None = None  # as sigma_xy_um, of the fallback
    fallback_sigma_theta_rad: float | None = None  # as sigma_theta_rad, of the fallback
    fallback_min_score: float = 0.0  # as gates.min_score, of the fallback
    feature: str = ""  # what is measured; "": the look's target
    offset_um: tuple[float, float] = (0.0, 0.0)  # from the target, in the part's frame
    turn_rad: float = 0.0  # of the feature's frame in the part's
    bias_through_focus: tuple[BiasAt, ...] = ()  # by rising dz_um; () = not predicted
    depth: Depth | None = None  # None: not computed


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """What the trials said of one chain."""

    chain: tuple[str, ...]  # routines, coarse to fine
    trials: int  # how many were tried
    success: int  # how many answered rightly
    success_lower: float  # one-sided 95 %, Clopper-Pearson
    silent: int  # answered, but wrong
    silent_upper: float  # one-sided 95 %, Clopper-Pearson
    bias_um: tuple[float, float] | None  # None: no success to measure it on
    sigma_um: float | None  # per axis
    worst_um: float | None  # largest error, wrong answers included
    sigma_theta_rad: float | None  # of the angle; None: not measured
    cost: float  # deterministic, in 640 x 480 box filters
    reason: str  # why it was chosen, kept as fallback, or rejected
    sigma_upper_um: float | None = None  # of the larger axis, one-sided 95 %
    ratio_to_limit: float | None = None  # rms, bias included, over `limit_xy_um`
    worst_trial: int | None = (
        None  # of the answers; `microplan render --trial` shows it
    )
    median_trial: int | None = None  # of the answers
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
    robustness: float | None = None  # rate of right answers, lower bound
    # 1 - most edges that meet themselves under a wrong turn
    uniqueness: float | None = None
    # share of the edges in view with nothing in front
    completeness: float | None = None
    cost: float | None = None  # of its chain, in 640 x 480 box filters
    # spread of its place in the direction known worst
    resolution_um: float | None = None
    rank: int | None = None  # of the scaled Jacobian
    # smallest singular value of the scaled Jacobian
    controllability: float | None = None
    conditioning: float | None = None  # largest over smallest singular value; 1 is best


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """The trials behind a look's choice; `scores` hold every chain tried."""

    tolerance_um: float  # what the look had to meet
    chosen: Score  # the chain that is used
    others: tuple[Score, ...]  # all other chains that were tried
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
    silent_upper: float  # as in `Score`, of the same trials


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """One measurement of one target through the microscope."""

    id: str  # what steps call the look
    target: str  # part, part.feature, part.post, tool.grip
    view: View  # zoom, focus, light
    scene: SceneRecord  # what is in view
    effects: tuple[EffectRow, ...]  # the optical effects ledger
    measure: Measure  # how its first feature is measured
    evidence: Evidence  # the trials behind the choice
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
    expected_um: float  # world height of the face if seated
    within_um: float  # how far off still counts as seated
    focus_um: tuple[float, ...]  # stops
    ring_radius_um: float  # the score is taken on edges about this radius; 0: all


@dataclass(frozen=True, slots=True, kw_only=True)
class LocateAction:
    """Measure `target` and remember where it is."""

    kind: Literal["locate"] = "locate"  # which action
    target: str  # what is measured
    look: str  # id of the look


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignAction:
    """Move `axes` until `target` is at `to`, looking after every move."""

    kind: Literal["align"] = "align"  # which action
    target: str  # what is measured and brought
    to: str  # where it is brought
    look: str  # id of the look
    axes: AxesName  # what moves
    path: tuple[
        str, ...
    ]  # order of the first approach: ("xy",), ("x", "y"), ("y", "x")


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspAction:
    """Close the jaws of `tool` on `target`."""

    kind: Literal["grasp"] = "grasp"  # which action
    target: str  # what is gripped
    tool: str  # with what
    opening_um: float  # of the jaws at the end
    across_um: float = 0.0  # of the part's origin, from the middle of the closed jaws


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveAction:
    """Nothing beyond the step's moves."""

    kind: Literal["move"] = "move"  # which action


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertAction:
    """Put `target` onto `onto` by `moves`; no sensor tells whether it seated."""

    kind: Literal["insert"] = "insert"  # which action
    target: str  # the hole, or its part
    onto: str  # the post
    moves: tuple[AxisMove, ...]  # in order


@dataclass(frozen=True, slots=True, kw_only=True)
class ReleaseAction:
    """Open the jaws of `tool`."""

    kind: Literal["release"] = "release"  # which action
    target: str  # what is let go
    tool: str  # that holds it
    opening_um: float  # of the jaws at the end


@dataclass(frozen=True, slots=True, kw_only=True)
class VerifyAction:
    """Decide whether `target` sits on `on`; every part of it can fail."""

    kind: Literal["verify"] = "verify"  # which action
    target: str  # what should sit
    on: str  # its seat
    look: str  # sees the target
    seat_look: str  # sees what it should sit on
    within_um: float  # how far off still counts as seated
    height: HeightSearch | None  # None: the height is not looked at
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

    method: Literal["servo", "look_then_move"]  # look after every move, or once
    gain: float  # share of the error that a correction takes away
    gain_limit: float  # stable below this for the stated latency
    tolerance_xy_um: float  # length of the error that is good enough
    tolerance_theta_rad: float | None  # None: the angle does not matter
    max_step_um: float  # a larger correction after the first approach is a fault
    max_cycles: int  # looks, then it has failed
    expected_cycles: float  # looks on average
    expected_s: float  # looks and settling, after the first approach
    approach_s: float = 0.0  # the first approach, zoom and focus set
    floor_s: float | None = None  # moves, settling and exposures alone
    ratio_to_floor: float | None = None  # of approach_s + expected_s
    choice: MethodChoice | None = None  # how the method was chosen; None: not told
    # a corrected target lands so near, per axis: what a look after it starts from;
    # None: not known, every look searches anew
    move_sigma_um: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class OnFailure:
    """What the executor does when a step fails with `code`."""

    code: str  # MP code, or a routine's own
    do: Literal["retry", "fallback", "stop"]  # what is done then
    times: int = 1  # how often at most


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """What sensors can test before and after, and the safe way out."""

    before: tuple[str, ...]  # what must hold before the step
    after: tuple[str, ...]  # what must hold after it
    retreat: tuple[AxisMove, ...]  # moves that lead clear, of an insertion
    on_failure: tuple[OnFailure, ...]  # what to do by code


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetRow:
    """One error term of a mechanical action, one sigma per axis."""

    term: str  # what errs
    sigma_um: float | None  # None: not modelled
    source: str  # where the number comes from
    along_rad: float | None = None  # world; None: alike in every direction


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """The error terms of one step and what they leave of its success."""

    rows: tuple[BudgetRow, ...]  # one row an error term
    limit_um: float | None  # capture radius, or the step's tolerance
    success_probability: float  # of this step
    advice: str  # the cheapest change that would pass; "" if it passes
    analysis: BudgetAnalysis | None = None  # of an insertion or a placement


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step, ready to run: moves, then looks and action."""

    id: str  # as in the task
    verb: str  # as in the task
    key: str  # sha256 over the content and the previous step's key
    physical: bool  # whether it moves or touches anything
    irreversible: bool  # whether it cannot be undone
    moves: tuple[AxisMove, ...]  # done first, in order
    looks: tuple[Look, ...]  # what the action looks at
    action: Action  # what the step does
    control: Control | None  # of an alignment
    conditions: Conditions  # before, after, and on failure
    budget: Budget  # error terms and P(success)
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
    status: Literal["feasible", "infeasible"]  # the executor refuses an infeasible plan
    reasons: tuple[Reason, ...]  # why it is infeasible; () if it is not
    provenance: Provenance  # what it was made from
    requirements: Requirements  # what the station must offer
    beliefs: tuple[Belief, ...]  # where things are before step 1
    features: tuple[FeaturePlace, ...]  # places of named features
    stage_start: AxisMove  # readings before step 1
    robot_start: AxisMove | None  # readings before step 1; None: no robot
    opening_start_um: float | None  # of the jaws before step 1; None: no tool
    success_probability: float  # of the whole run
    success_goal: float | None  # what the task asks for; None: nothing
    steps: tuple[Step, ...]  # in order
    parts: tuple[Solid, ...] = ()  # the room they take up; (): not told
    fingers: tuple[Fingers, ...] = ()  # of the tool; (): not told


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
