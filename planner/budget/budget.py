"""Error budgets of mechanical actions: every term with its source."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from microplan.planner.assembly.assembly import Carrier, State, locate_place
from microplan.planner.assembly.holding import between_jaws, turn_miss
from microplan.planner.assembly.mating import mating_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.probability.fit_probability import RoundFit
from microplan.planner.budget.probability.outline_fit import OutlineFit
from microplan.planner.task.task import Task, TaskStep
from microplan.planner.task.workcell import Workcell
from microplan.schemas.plan import Budget, BudgetRow, ModelCost, Repeatability

SECONDS_PER_MIN = 60.0
FOCUS_TERM = "lateral shift with focus"
MEASURED, PICTURES = "measurement", "discrepancy of pictures"  # of a target
TILT_IN_JAWS = BudgetRow(
    term="tilt of the part in the jaws",
    sigma_um=None,
    source="not modelled: no look and no drawing tells it",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PastMeasurement:
    """Accuracy of the last look at a target, as known at compile time."""

    name: str
    step: str  # id of the step that looked
    sigma_um: float
    magnification: float
    focus_um: float
    distortion_sigma_um: float  # at the target's position
    coherence_um: float  # half-width of its displacement by partly coherent light
    coherence_rad: float = 0.0  # and of its rotation
    response_um: float = 0.0  # the same by a camera's response that is not stated
    response_rad: float = 0.0
    sigma_theta_rad: float | None = None  # None: the angle was not measured
    place_um: tuple[float, float] = (0.0, 0.0)  # from the optical axis
    # `sigma_um` without the magnification error; None: the same
    sigma_without_scale_um: float | None = None
    moved_um: float = 0.0  # what moves since add to both sigmas; stated, not measured
    trueness_um: float = 0.0  # part of both: what real pictures add to images
    repeatability: Repeatability | None = None  # what it is known by; None: unknown
    # what errors of its images cost, its sigma in those above; None: nothing
    model_cost: ModelCost | None = None
    # of that the chain's own, which is in those above; None: `model_cost`
    own_cost: ModelCost | None = None

    @property
    def edges_rad(self) -> float:
        """Return the half-width of its rotation by what moves edges alike."""
        return self.coherence_rad + self.response_rad

    @property
    def term(self) -> str:
        """Return the name of its error in a budget."""
        return f"{MEASURED} of {self.name}"


def fit_of(task: Task, insert: StepState) -> RoundFit | OutlineFit | None:
    """Return the fit of an insertion, None if hole or post is unclear."""
    mating = mating_of(task, insert.step, insert.after)
    if mating is None:
        return None
    hole, _, _ = (insert.step.target or "").partition(".")
    part, _, shaft = (insert.step.onto or "").partition(".")
    in_hole = task.parts[hole].profile_tolerance_um
    on_shaft = task.parts[part].posts[shaft].profile_tolerance_um
    if mating.shape is not None:
        return OutlineFit(
            shape=mating.shape,
            hole_tolerance_um=in_hole,
            shaft_tolerance_um=on_shaft,
            taper_um=mating.taper_um / 2,
        )
    return RoundFit(
        hole_um=mating.hole_um / 2,
        shaft_um=mating.shaft_um / 2,
        hole_tolerance_um=in_hole,
        shaft_tolerance_um=on_shaft,
        taper_um=mating.taper_um / 2,
    )


def blind_rows(
    cell: Workcell,
    travel_um: Mapping[Carrier, float],
    hole: PastMeasurement | None,
    shaft: PastMeasurement | None,
    takes_s: float = 0.0,
    *,
    doing: str = "inserting",
) -> tuple[BudgetRow, ...]:
    """Return the error rows of an insertion, or a placement, unseen by the servo.

    `travel_um` is how far stage and robot go in z, each along an axis of its own tilt;
    `takes_s` the time of that, s.
    """
    rows = []
    stage_um, robot_um = travel_um["stage"], travel_um["robot"]
    if stage_um or not robot_um:
        rows.append(
            _row(
                "stage axis tilt over the travel",
                cell.stage.axis_tilt_sigma_rad * stage_um,
                f"workcell axis_tilt_sigma_mrad x {stage_um:g} um",
            )
        )
    if robot_um:
        source = "not modelled: the workcell states no tilt of the robot, which goes "
        rows.append(
            _row("robot axis tilt over the travel", None, f"{source}{robot_um:g} um")
        )
    drift_um = cell.stage.drift_um_per_min * takes_s / SECONDS_PER_MIN
    source = f"workcell drift_um_per_min x {takes_s:.3g} s"
    rows.append(_row(f"drift while {doing}", drift_um, source))
    if hole is not None and shaft is not None:
        rows += looking_rows(cell, hole, shaft)
    return (*rows, TILT_IN_JAWS)


def _row(term: str, sigma_um: float | None, source: str) -> BudgetRow:
    """Return a row that is alike in every direction."""
    return BudgetRow(term=term, sigma_um=sigma_um, source=source)


def looking_rows(
    cell: Workcell, hole: PastMeasurement, shaft: PastMeasurement
) -> list[BudgetRow]:
    """Return the differential errors of two looks at different heights and zooms."""
    apart_um = abs(hole.focus_um - shaft.focus_um)
    zoomed = not math.isclose(hole.magnification, shaft.magnification)
    jump_um = cell.optics.zoom.parcentric_sigma_um if zoomed else 0.0
    return [
        *_measured_rows(hole),
        *_measured_rows(shaft),
        _row(
            FOCUS_TERM,
            cell.optics.focus.lateral_sigma_um_per_um * apart_um,
            f"workcell lateral_sigma_um_per_um x {apart_um:g} um",
        ),
        _row(
            "lens distortion",
            math.hypot(hole.distortion_sigma_um, shaft.distortion_sigma_um),
            "workcell distortion_sigma at the places of both looks",
        ),
        _row(
            "partial coherence",
            0.0,
            "coherence: a bias of at most "
            f"{hole.coherence_um + shaft.coherence_um:.3g} um, in the lower bound of "
            "P(success), measured on dilated outlines",
        ),
        _row(
            "response of the camera",
            0.0,
            f"response: a bias of at most {hole.response_um + shaft.response_um:.3g} "
            "um, in the lower bound of P(success), measured on changed counts",
        ),
        _row(
            "parcentric jump of the zoom",
            jump_um,
            "workcell parcentric_sigma_um"
            if zoomed
            else "no zoom change between the looks",
        ),
        _scale_row(cell, hole, shaft, zoomed=zoomed),
    ]


def _measured_rows(seen: PastMeasurement) -> list[BudgetRow]:
    """Return the error of a look, and what of it real pictures add to images.

    The scale is common to both looks and has its own row.
    """
    sigma_um, source = seen.sigma_um, "trials"
    own_um, true_um = seen.sigma_without_scale_um, seen.trueness_um
    if own_um is not None and own_um < sigma_um:
        source += f" ({sigma_um:.3g} um), less the zoom's scale, which has its own row"
        sigma_um = own_um
    if true_um <= 0:
        return [_row(seen.term, sigma_um, source)]
    true_um = min(true_um, sigma_um)
    left_um = math.sqrt(sigma_um**2 - true_um**2)
    return [
        _row(seen.term, left_um, f"{source}, but for the next row"),
        _row(
            f"{PICTURES} of {seen.name}",
            true_um,
            "workcell discrepancy, in trials: no average of frames makes it smaller",
        ),
    ]


def _scale_row(
    cell: Workcell, hole: PastMeasurement, shaft: PastMeasurement, *, zoomed: bool
) -> BudgetRow:
    """Return the displacement by an unknown magnification, away from the axis."""
    far_um = [math.hypot(*seen.place_um) for seen in (hole, shaft)]
    x_um, y_um = (hole if far_um[0] >= far_um[1] else shaft).place_um
    apart_um = math.hypot(*far_um)  # two zooms err by themselves
    if not zoomed:
        x_um = hole.place_um[0] - shaft.place_um[0]
        y_um = hole.place_um[1] - shaft.place_um[1]
        apart_um = math.hypot(x_um, y_um)
    said = "of both looks" if zoomed else "that the looks differ by, at one zoom"
    return BudgetRow(
        term="zoom scale over the distance from the axis",
        sigma_um=cell.optics.zoom.scale_sigma * apart_um,
        source=f"workcell scale_sigma x {apart_um:.4g} um {said}",
        along_rad=math.atan2(y_um, x_um) if apart_um > 0 else None,
    )


def grasp_budget(task: Task, state: State, step: TaskStep) -> Budget:
    """Return the budget of a grasp: the clearance of the part between the jaws.

    P also counts that they turn it to another angle than later steps are planned for.
    """
    clearance = between_jaws(task, state, step)
    grip = locate_place(task, state, f"{step.tool}.grip")
    total = math.hypot(clearance.sigma_um, grip.sigma_xy_um)
    between = _inside(clearance.half_room_um, clearance.offset_um, total)
    return Budget(
        rows=(
            _row("place of the part", clearance.sigma_um, "alignment before"),
            _row("place of the jaws", grip.sigma_xy_um, "workcell"),
        ),
        limit_um=clearance.room_um,
        success_probability=between * (1 - (turn_miss(task, state, step) or 0.0)),
        advice="",
    )


def release_budget(task: Task, tool: str) -> Budget:
    """Return the budget of a release: the probability that the part sticks."""
    stick = task.workcell.tools[tool].stick_probability
    source = (
        "an interval of forces gives no chance (the step's verdict has it); "
        f"stick_probability {stick:g} of the workcell (0 unless stated)"
    )
    row = _row("adhesion to the fingers", None, source)
    return replace(EMPTY_BUDGET, rows=(row,), success_probability=1 - stick)


def verify_budget(
    cell: Workcell,
    step: TaskStep,
    target: PastMeasurement | None,
    seat: PastMeasurement | None,
) -> Budget:
    """Return the measurement errors of a verification; it moves nothing.

    A good assembly that is refused is no mechanical miss, so P stays 1.
    """
    rows = [] if target is None or seat is None else looking_rows(cell, target, seat)
    return replace(EMPTY_BUDGET, rows=tuple(rows), limit_um=step.within_um)


# Of a step that cannot miss mechanically
EMPTY_BUDGET = Budget(rows=(), limit_um=None, success_probability=1.0, advice="")


def _inside(half_um: float, offset_um: float, sigma_um: float) -> float:
    """Return the probability that a normal error about `offset_um` is within +-half."""
    if half_um <= 0:
        return 0.0
    if sigma_um <= 0:
        return float(abs(offset_um) <= half_um)
    sides = (half_um - offset_um, half_um + offset_um)
    return sum(math.erf(side / sigma_um / math.sqrt(2)) for side in sides) / 2
