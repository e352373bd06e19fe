"""Swept volumes of moves or closing jaws, with what they would hit.

Moving bodies are taken as their convex hulls, which errs on the safe side. Every
clearance must hold at two sigma of the bodies' relative position. The stage's surface
is taken as unbounded: whatever the robot carries must stay above it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import shapely
from shapely.geometry.base import BaseGeometry

from microplan.arrays import Box
from microplan.planner.assembly.assembly import (
    Axis4,
    Body,
    Carrier,
    State,
    bodies,
    owner_of,
)
from microplan.planner.assembly.shapes import hull, polygon, swept
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task, TaskStep


def jaw_hits(
    task: Task, state: State, opening_um: float, between: str
) -> tuple[Hit, ...]:
    """Return the collisions of the fingers that go to another opening.

    The part `between` them is meant to be touched; the stage's surface is as far below
    as it was.
    """
    after = replace(state, opening_um=opening_um)
    hits = sweep_hits(task, state, after, carrier="robot")
    return tuple(
        hit
        for hit in hits
        if owner_of(hit.moving) == state.tool
        and hit.still != SURFACE
        and owner_of(hit.still) != between
    )


def report_jaws(
    task: Task, state: State, step: TaskStep, opening_um: float, report: Report
) -> None:
    """Report what the fingers would touch while they close or open."""
    between = owner_of(step.target or "")
    for hit in jaw_hits(task, state, opening_um, between):
        report.refuse(
            "MP303",
            step.spans.get("opening_um", step.where),
            f"step {step.id!r}: {hit.moving}, on its way from {state.opening_um:g} to "
            f"{opening_um:g} um, would touch {hit.still}: {hit.gap_um:.3g} um apart at "
            f"the nominal place, {hit.needed_um:.3g} um needed at 2 sigma",
            "another opening, or another place",
        )


SIGMAS = 2.0  # at which clearances must hold
TURN_RAD = math.radians(1.0)
SURFACE = "the stage"
ROUNDING_UM = 1e-6  # what sums of readings may miss contact by


@dataclass(frozen=True, slots=True, kw_only=True)
class Hit:
    """Two bodies that a move would bring together, or nearly."""

    moving: str
    still: str
    gap_um: float  # what is left between them, sideways or in height, nominally
    needed_um: float  # two sigma

    @property
    def sigma_um(self) -> float:
        """Return the standard deviation of the gap, um."""
        return self.needed_um / SIGMAS

    @property
    def chance(self) -> float:
        """Return the probability that they touch: that a normal gap is below 0."""
        if self.needed_um <= 0:
            return float(self.gap_um <= 0)
        return math.erfc(self.gap_um / self.sigma_um / math.sqrt(2)) / 2


def sweep_hits(
    task: Task,
    before: State,
    after: State,
    *,
    carrier: Carrier,
    deviation: Box | None = None,
    exempt: frozenset[frozenset[str]] = frozenset(),
) -> tuple[Hit, ...]:
    """Return the collisions of bodies on `carrier` that go from `before` to `after`.

    Parameters
    ----------
    task : Task
        Gives the shapes.
    before, after : State
        States that differ by readings of `carrier` only; motion runs straight.
    carrier : {"stage", "robot"}
        Which bodies move.
    deviation : (x_min, y_min, x_max, y_max) um, optional
        Offsets from nominal that the moving bodies may have, instead of their sigma.
    exempt : set of pairs of owners
        Pairs that are meant to touch.

    Returns
    -------
    tuple of Hit
        In order of names; empty if everything stays clear.
    """
    near = sweep_gaps(
        task, before, after, carrier=carrier, deviation=deviation, exempt=exempt
    )
    return tuple(hit for hit in near if hit.gap_um <= hit.needed_um)


def sweep_gaps(
    task: Task,
    before: State,
    after: State,
    *,
    carrier: Carrier,
    deviation: Box | None = None,
    exempt: frozenset[frozenset[str]] = frozenset(),
) -> tuple[Hit, ...]:
    """Return what every body on `carrier` leaves to those whose heights it meets.

    As `sweep_hits`, of pairs that stay clear too: the least gap of each.
    """
    found = [
        hit
        for start, end in itertools.pairwise(_legs(before, after, carrier))
        for hit in _leg_gaps(task, start, end, carrier, deviation, exempt)
    ]
    found.sort(key=lambda hit: -hit.gap_um)  # the closest of a pair comes last
    worst = {(hit.moving, hit.still): hit for hit in found}
    return tuple(worst[pair] for pair in sorted(worst))


def _leg_gaps(
    task: Task,
    before: State,
    after: State,
    carrier: Carrier,
    deviation: Box | None,
    exempt: frozenset[frozenset[str]],
) -> list[Hit]:
    """Return the gaps of one leg, which is as good as straight."""
    all_before, all_after = bodies(task, before), bodies(task, after)
    ends = {b.name: b for b in all_after}
    moving = [b for b in all_before if b.carrier == carrier]
    still = [b for b in all_before if b.carrier != carrier]
    hits = [
        hit
        for body in moving
        for other in still
        if frozenset((body.owner, other.owner)) not in exempt
        and (hit := _gap(body, ends[body.name], other, deviation)) is not None
    ]
    seating = {owner for pair in exempt for owner in pair}
    hits += [
        hit
        for body in all_before
        if body.carrier == "robot"
        and body.owner not in seating
        and (hit := _surface_gap(task, before, after, body, ends[body.name]))
        is not None
    ]
    return hits


def _surface_gap(
    task: Task, before: State, after: State, body: Body, end: Body
) -> Hit | None:
    """Return what a body on the robot leaves to the stage's surface.

    What rests on the surface may leave it.
    """
    stage = task.workcell.stage
    start_um = body.z_low_um - stage.datum_z_um - before.stage.z_um
    end_um = end.z_low_um - stage.datum_z_um - after.stage.z_um
    needed_um = SIGMAS * math.hypot(body.sigma_z_um, stage.axes.repeatability_z_um)
    gap_um = min(start_um, end_um)
    if end_um > start_um > -ROUNDING_UM:
        return None
    return Hit(moving=body.name, still=SURFACE, gap_um=gap_um, needed_um=needed_um)


def _legs(before: State, after: State, carrier: Carrier) -> tuple[State, ...]:
    """Return the states between which a move is as good as straight.

    A rotation is cut into legs of at most TURN_RAD: the hull of a leg's ends misses
    less than a micrometre of the arc at the far end of a 20 mm finger.
    """
    start, end = before.axes(carrier), after.axes(carrier)
    count = max(1, math.ceil(abs(end.theta_rad - start.theta_rad) / TURN_RAD))
    states = [before]
    for k in range(1, count):
        part = k / count
        axis = Axis4(
            x_um=start.x_um + part * (end.x_um - start.x_um),
            y_um=start.y_um + part * (end.y_um - start.y_um),
            z_um=start.z_um + part * (end.z_um - start.z_um),
            theta_rad=start.theta_rad + part * (end.theta_rad - start.theta_rad),
        )
        states.append(before.carried(carrier, axis))
    return (*states, after)


def _gap(body: Body, end: Body, other: Body, deviation: Box | None) -> Hit | None:
    """Return what is left between two bodies, or None if their heights stay clear."""
    if not _heights_meet(body, end, other):
        return None
    sigma = other.sigma_xy_um
    if deviation is None:
        sigma = math.hypot(sigma, body.sigma_xy_um)
    covered = _covered(body, end, deviation or (0.0, 0.0, 0.0, 0.0))
    gap_um = covered.distance(polygon(other.outline))
    needed_um = SIGMAS * sigma
    return Hit(moving=body.name, still=other.name, gap_um=gap_um, needed_um=needed_um)


def _covered(body: Body, end: Body, deviation: Box) -> BaseGeometry:
    """Return what the body's hull covers sideways: start, end and all between."""
    ends = [swept(hull(b.outline), deviation) for b in (body, end)]
    covered: BaseGeometry = shapely.union_all(ends).convex_hull
    return covered


def _heights_meet(body: Body, end: Body, other: Body) -> bool:
    """Return whether the height ranges come within two sigma of each other.

    Bodies that rest on each other at the start and only part are clear.
    """
    margin = SIGMAS * math.hypot(body.sigma_z_um, other.sigma_z_um)
    low = min(body.z_low_um, end.z_low_um)
    high = max(body.z_high_um, end.z_high_um)
    if low >= other.z_high_um + margin or high <= other.z_low_um - margin:
        return False
    above = body.z_low_um >= other.z_high_um and end.z_low_um > body.z_low_um
    below = body.z_high_um <= other.z_low_um and end.z_high_um < body.z_high_um
    return not (above or below)
