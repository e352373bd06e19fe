"""A step: moves, looks, action, control, conditions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from microplan.schemas.plan.actions import Action, AxisMove
from microplan.schemas.plan.looks import EffectRow, Look
from microplan.schemas.plan.verdicts import (
    BudgetAnalysis,
    FitVerdict,
    GraspVerdict,
    MethodChoice,
    PlacingVerdict,
    ReleaseVerdict,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """How a step servoes."""

    method: Literal["servo", "look_then_move"]  # look after every move, or once
    gain: float  # share of the error that a correction takes away
    gain_limit: float  # a servo settles below it: no look is of a frame before its move
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
