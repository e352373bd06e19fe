"""Error budgets of the mechanical actions: every term with its source."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from microplan.planner.assembly.assembly import Carrier, State, locate_place
from microplan.planner.assembly.holding import between_jaws
from microplan.planner.assembly.mating import mating_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.probability.fit_probability import RoundFit
from microplan.planner.task.task import Task, TaskStep
from microplan.planner.task.workcell import Workcell
from microplan.schemas.plan import Budget, BudgetRow

SECONDS_PER_MIN = 60.0
FOCUS_TERM = "lateral shift with focus"
NOT_MODELLED = (
    ("tilt of the part in the jaws", "not modelled: no look and no drawing tells it"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PastMeasurement:
    """What a look promised of its target: the compile-time memory of a measurement."""

    name: str
    step: str  # id of the step that looked
    sigma_um: float
    magnification: float
    focus_um: float
    distortion_sigma_um: float  # at the target's place
    coherence_um: float  # how far partly coherent light moves its middle
    sigma_theta_rad: float | None = None  # None: the angle was not measured
    place_um: tuple[float, float] = (0.0, 0.0)  # from the optical axis
    # `sigma_um` without what the zoom's scale makes of the place; None: the same
    steady_um: float | None = None

    @property
    def term(self) -> str:
        """Return the name of its error in a budget."""
        return f"measurement of {self.name}"


def fit_of(task: Task, insert: StepState) -> RoundFit | None:
    """Return the fit of an insertion, None if its hole or shaft is not round."""
    mating = mating_of(task, insert.step, insert.after)
    if mating is None:
        return None
    hole, _, _ = (insert.step.target or "").partition(".")
    part, _, shaft = (insert.step.onto or "").partition(".")
    return RoundFit(
        hole_um=mating.hole_um / 2,
        shaft_um=mating.shaft_um / 2,
        hole_tolerance_um=task.parts[hole].profile_tolerance_um,
        shaft_tolerance_um=task.parts[part].posts[shaft].profile_tolerance_um,
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
    """Return the terms of an insertion, or of a placement, that the servo cannot see.

    `travel_um` is how far stage and robot go in z, each along an axis of its own tilt;
    `takes_s` how long that takes.
    """
    rows = []
    if travel_um["stage"] or not travel_um["robot"]:
        rows.append(
            BudgetRow(
                term="stage axis tilt over the travel",
                sigma_um=cell.stage.axis_tilt_sigma_rad * travel_um["stage"],
                source=f"workcell axis_tilt_sigma_mrad x {travel_um['stage']:g} um",
            )
        )
    if travel_um["robot"]:
        rows.append(
            BudgetRow(
                term="robot axis tilt over the travel",
                sigma_um=None,
                source="not modelled: the workcell states no tilt of the robot, which "
                f"goes {travel_um['robot']:g} um",
            )
        )
    drift_um = cell.stage.drift_um_per_min * takes_s / SECONDS_PER_MIN
    rows.append(
        BudgetRow(
            term=f"drift while {doing}",
            sigma_um=drift_um,
            source=f"workcell drift_um_per_min x {takes_s:.3g} s",
        )
    )
    if hole is not None and shaft is not None:
        rows += looking_rows(cell, hole, shaft)
    rows += [BudgetRow(term=t, sigma_um=None, source=s) for t, s in NOT_MODELLED]
    return tuple(rows)


def looking_rows(
    cell: Workcell, hole: PastMeasurement, shaft: PastMeasurement
) -> list[BudgetRow]:
    """Return what two looks at different heights and zooms differ by."""
    apart_um = abs(hole.focus_um - shaft.focus_um)
    rows = [_measured_row(seen) for seen in (hole, shaft)]
    rows.append(
        BudgetRow(
            term=FOCUS_TERM,
            sigma_um=cell.optics.focus.lateral_sigma_um_per_um * apart_um,
            source=f"workcell lateral_sigma_um_per_um x {apart_um:g} um",
        )
    )
    rows.append(
        BudgetRow(
            term="lens distortion",
            sigma_um=math.hypot(hole.distortion_sigma_um, shaft.distortion_sigma_um),
            source="workcell distortion_sigma at the places of both looks",
        )
    )
    rows.append(
        BudgetRow(
            term="partial coherence",
            sigma_um=math.hypot(hole.coherence_um, shaft.coherence_um),
            source="workcell coherence: edges move, middles of symmetry stay",
        )
    )
    zoomed = not math.isclose(hole.magnification, shaft.magnification)
    rows.append(
        BudgetRow(
            term="parcentric jump of the zoom",
            sigma_um=cell.optics.zoom.parcentric_sigma_um if zoomed else 0.0,
            source="workcell parcentric_sigma_um"
            if zoomed
            else "no zoom change between the looks",
        )
    )
    rows.append(_scale_row(cell, hole, shaft, zoomed=zoomed))
    return rows


def _measured_row(seen: PastMeasurement) -> BudgetRow:
    """Return what a look errs by; the scale is common to both and has its own row."""
    steady_um, source = seen.steady_um, "trials"
    if steady_um is None or steady_um >= seen.sigma_um:
        return BudgetRow(term=seen.term, sigma_um=seen.sigma_um, source=source)
    source += f" ({seen.sigma_um:.3g} um), less the zoom's scale, which has its own row"
    return BudgetRow(term=seen.term, sigma_um=steady_um, source=source)


def _scale_row(
    cell: Workcell, hole: PastMeasurement, shaft: PastMeasurement, *, zoomed: bool
) -> BudgetRow:
    """Return what an unknown magnification moves, along the line from the axis."""
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
    """Return the budget of a grasp: does the part stand free between the jaws."""
    stands = between_jaws(task, state, step)
    grip = locate_place(task, state, f"{step.tool}.grip")
    rows = (
        BudgetRow(
            term="place of the part",
            sigma_um=stands.sigma_um,
            source="alignment before",
        ),
        BudgetRow(
            term="place of the jaws", sigma_um=grip.sigma_xy_um, source="workcell"
        ),
    )
    total = math.hypot(stands.sigma_um, grip.sigma_xy_um)
    return Budget(
        rows=rows,
        limit_um=stands.room_um,
        success_probability=_inside(stands.half_room_um, stands.offset_um, total),
        advice="",
    )


def release_budget(task: Task, tool: str) -> Budget:
    """Return the budget of a release: the chance that the part follows a finger."""
    stick = task.workcell.tools[tool].stick_probability
    row = BudgetRow(
        term="adhesion to the fingers",
        sigma_um=None,
        source=f"an interval of forces gives no chance (the step's verdict has it); "
        f"stick_probability {stick:g} of the workcell (0 unless stated)",
    )
    return Budget(
        rows=(row,),
        limit_um=None,
        success_probability=1 - stick,
        advice="",
    )


def verify_budget(
    cell: Workcell,
    step: TaskStep,
    target: PastMeasurement | None,
    seat: PastMeasurement | None,
) -> Budget:
    """Return what blurs a verification; it can refuse, but it moves nothing.

    A good assembly that is refused is no mechanical miss, so P stays 1.
    """
    rows = () if target is None or seat is None else looking_rows(cell, target, seat)
    return Budget(
        rows=tuple(rows), limit_um=step.within_um, success_probability=1.0, advice=""
    )


def empty_budget() -> Budget:
    """Return the budget of a step that cannot miss mechanically."""
    return Budget(rows=(), limit_um=None, success_probability=1.0, advice="")


def _inside(half_um: float, offset_um: float, sigma_um: float) -> float:
    """Return the chance that a normal place about `offset_um` is within +-half."""
    if half_um <= 0:
        return 0.0
    if sigma_um <= 0:
        return float(abs(offset_um) <= half_um)
    sides = (half_um - offset_um, half_um + offset_um)
    return sum(math.erf(side / sigma_um / math.sqrt(2)) for side in sides) / 2
