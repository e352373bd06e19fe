"""Lower bound of one step's probability: sigmas at their ends, biases at a corner."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from microplan.planner.assembly.assembly import owner_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.insert_budget import insertion_of
from microplan.planner.budget.insertion import Insertion
from microplan.planner.budget.lower_bound.bounded_history import (
    bias_rad,
    bias_um,
    bounded_history,
    model_bias_um,
)
from microplan.planner.budget.measurement_history import MeasurementHistory
from microplan.planner.budget.placement import (
    PlacementContext,
    lever_um,
    placement_context,
)
from microplan.planner.budget.placement_budget import (
    angle_error,
    placement_errors,
    placement_residual,
)
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.budget.probability.outline_fit import OutlineFit
from microplan.planner.budget.step_budget import left_of
from microplan.planner.task.task import Task
from microplan.schemas.plan import BiasRow

DIRECTIONS = 8  # of a bias beside an offset that is there already
TRIALS = "trials: its mean is known so well"
PAIRS = "pairs of images: what errors of the images cost is known so well"
IMAGES = "images of {}"
APPROACH = "approach by {}"


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredStep:
    """A step whose probability hangs on measurements, and the history it is by."""

    task: Task
    states: tuple[StepState, ...]
    here: StepState
    history: MeasurementHistory

    @property
    def placement(self) -> PlacementContext | None:
        """Return the placement of a release, None of any other step."""
        if self.here.step.verb != "release":
            return None
        return placement_context(self.task, self.states, self.here, self.history)

    @property
    def pair(self) -> tuple[PastMeasurement | None, PastMeasurement | None]:
        """Return the looks at both parts."""
        put, step = self.placement, self.here.step
        if put is not None:
            return put.seen
        hole, shaft = (owner_of(name or "") for name in (step.target, step.onto))
        return (self.history.seen.get(hole), self.history.seen.get(shaft))

    @property
    def angles(self) -> tuple[PastMeasurement | None, ...]:
        """Return the looks at both parts' angles, where these matter."""
        put = self.placement
        if put is not None:
            return put.angles_seen
        job = None if self.here.step.verb != "insert" else _job(self)
        return () if job is None or job.angle is None else self.pair

    @property
    def is_measured(self) -> bool:
        """Return whether it is an insertion or a placement."""
        return self.here.step.verb == "insert" or self.placement is not None


def measured_terms(steps: Sequence[MeasuredStep]) -> int:
    """Return how many measured numbers the steps' bounds take an end of.

    Of each look a variance and two biases, of each angle one of both; as many of what
    errors of its images cost.
    """
    places, angles = set(), set()
    for step in steps:
        for seen in (*step.pair, step.history.before):
            if seen is not None and seen.repeatability is not None:
                places.add((seen.step, seen.name, TRIALS))
                if seen.model_cost is not None:
                    places.add((seen.step, seen.name, PAIRS))
        for seen in step.angles:
            if seen is not None and seen.repeatability is not None:
                angles.add((seen.step, seen.name, TRIALS))
                if seen.model_cost is not None:
                    angles.add((seen.step, seen.name, PAIRS))
    return 3 * len(places) + 2 * len(angles)


def success_share(step: MeasuredStep, doubt: float) -> float:
    """Return the step's lower bound over its point estimate, in 0..1.

    Each measured number has its end at `doubt`. A larger sigma of an approach may help,
    since fewer alignments end at their first look: so the measured sigmas count, too.
    """
    known = step.history
    point = _success(step, known, doubt, biased=False)
    if point <= 0:
        return 0.0
    ends = (known, bounded_history(known, doubt))
    low = min(_success(step, end, doubt, biased=True) for end in ends)
    return min(1.0, max(0.0, low / point))


def _success(
    step: MeasuredStep, history: MeasurementHistory, doubt: float, *, biased: bool
) -> float:
    """Return the probability by a history, biases at the worst corner or 0."""
    told = replace(step, history=history)
    job, angle = _job(told), None
    put = told.placement
    if put is not None:
        angle = angle_error(put)
    if job is None:
        return 1.0
    rows = list(biases(step, doubt)) if biased else []
    later = sum(row.half_width_um for row in rows if not _is_approach(row))
    first = sum(row.half_width_um for row in rows)
    turn = sum(bias_rad(seen, doubt) for seen in step.angles) if biased else 0.0
    if not math.isfinite(first + turn):
        return 0.0
    return (1 - worst_miss(job, later, first)) * _within(told, angle, turn)


def _job(step: MeasuredStep) -> Insertion | None:
    """Return the step's lateral errors, None where it has no round fit."""
    put = step.placement
    if put is not None:
        return placement_errors(put, placement_residual(put))
    task, states, here, history = step.task, step.states, step.here, step.history
    left = left_of(task, states, here, history)
    return insertion_of(task, states, here, left, history.seen)


def _within(step: MeasuredStep, angle: AngleError | None, turn_rad: float) -> float:
    """Return the probability that a placed part's angle is within its limit."""
    put = step.placement
    limit = None if put is None else put.verify.within_rad
    if angle is None or limit is None:
        return 1.0
    room_rad = limit - turn_rad
    return 1 - angle.beyond(room_rad) if room_rad > 0 else 0.0


def biases(step: MeasuredStep, doubt: float) -> Iterator[BiasRow]:
    """Yield the sides of the box of biases; those that are common add up as one."""
    name = step.here.step.id
    for seen in step.pair:
        if seen is not None:
            yield BiasRow(
                step=name, term=seen.term, half_width_um=bias_um(seen, doubt),
                source=TRIALS,
            )  # fmt: skip
            yield from _image_bias(name, "{}", seen, doubt)
    before = step.history.before
    if before is not None:
        yield BiasRow(
            step=name, term=APPROACH.format(before.name),
            half_width_um=bias_um(before, doubt), source=TRIALS,
        )  # fmt: skip
        yield from _image_bias(name, APPROACH, before, doubt)
    yield from _lever_biases(step, doubt)
    yield from stated_biases(step)


def _image_bias(
    step: str, of: str, seen: PastMeasurement, doubt: float
) -> Iterator[BiasRow]:
    """Yield the bias by errors of a look's images, walls and finish among them."""
    if seen.model_cost is not None:
        yield BiasRow(
            step=step,
            term=of.format(IMAGES.format(seen.name)),
            half_width_um=model_bias_um(seen, doubt),
            source=PAIRS,
        )


def stated_biases(step: MeasuredStep) -> Iterator[BiasRow]:
    """Yield biases that are not of trials: what has an interval and no distribution.

    Coherence moves the edges of both looks together, and so does a response that is
    not stated: their sums.
    """
    known = [seen for seen in step.pair if seen is not None]
    for term, moved_um, source in (
        ("partial coherence", sum(s.coherence_um for s in known), "coherence"),
        ("response of the camera", sum(s.response_um for s in known), "response"),
    ):
        if moved_um > 0:
            yield BiasRow(
                step=step.here.step.id, term=term, half_width_um=moved_um,
                source=f"workcell {source}, both looks together",
            )  # fmt: skip


def _lever_biases(step: MeasuredStep, doubt: float) -> Iterator[BiasRow]:
    """Yield the displacements by biases of angles at the ends of levers."""
    for angle, arm_um in _levers(step):
        if arm_um > 0:
            yield BiasRow(
                step=step.here.step.id,
                term=f"angle of {angle.name} over {arm_um:.4g} um",
                half_width_um=arm_um * bias_rad(angle, doubt),
                source=TRIALS,
            )


def _levers(step: MeasuredStep) -> Iterator[tuple[PastMeasurement, float]]:
    """Yield the looks at both parts' angles with their levers, um.

    Of a shaft that goes in at some angles it reaches to its farthest point.
    """
    put = step.placement
    if put is None:
        job = _job(step)
        arm_um = 0.0 if job is None else job.reach_um + math.hypot(*job.lever_um)
        yield from ((seen, arm_um) for seen in step.angles if seen is not None)
    elif put.align is not None:
        points = (put.verify.target or "", put.verify.on or "")
        looks = zip(put.seen, put.angles_seen, strict=True)
        for owner, point, (seen, angle) in zip(
            (put.part, put.seat), points, looks, strict=True
        ):
            if seen is not None and angle is not None:
                yield angle, math.hypot(*lever_um(put, owner, seen.name, point))


def _is_approach(row: BiasRow) -> bool:
    """Return whether a bias acts only where a first look ends the alignment."""
    return row.term.startswith(APPROACH.format(""))


def worst_miss(job: Insertion, bias_um: float, first_um: float) -> float:
    """Return the largest probability of a miss, over biases of these lengths.

    Parameters
    ----------
    job : Insertion
        The errors, without these biases.
    bias_um : float
        The largest bias, in any direction.
    first_um : float
        That of alignments that end at their first look.
    """
    found = 0.0
    for share, left in job.shares:
        ends = job.early is not None and left is job.early[1]
        found += share * _worst(job.after(left), first_um if ends else bias_um)
    return found


def _worst(job: Insertion, bias_um: float) -> float:
    """Return the largest probability of a miss over a disc of biases."""
    if bias_um <= 0:
        return job.miss
    if job.offset_um == 0 or isinstance(job.fit, OutlineFit):
        return max(job.miss, job.missed_with(bias_um))
    ways = [job.offset_rad + 2 * math.pi * k / DIRECTIONS for k in range(DIRECTIONS)]
    return max(job.miss, *(_moved(job, bias_um, way).miss for way in ways))


def _moved(job: Insertion, by_um: float, way_rad: float) -> Insertion:
    """Return the insertion with one more offset."""
    x = job.offset_um * math.cos(job.offset_rad) + by_um * math.cos(way_rad)
    y = job.offset_um * math.sin(job.offset_rad) + by_um * math.sin(way_rad)
    return replace(job, offset_um=math.hypot(x, y), offset_rad=math.atan2(y, x))
