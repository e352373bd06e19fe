"""One look: set the view, grab the region, measure, judge the answer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from executor.drivers import Counts
from executor.errors import ExecutorError
from executor.rig import Rig
from featuresel.routines import Failure, FloatArray, Guess, Measurement
from featuresel.routines.chain import measure_chain
from schemas.plan import Gates, Look, OnFailure, RoutineUse
from schemas.pose import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class Sighting:
    """Where a look found its target, world frame."""

    target: str
    x_um: float
    y_um: float
    theta_rad: float | None  # None: not measured
    score: float
    spread_um: float  # the routine's own estimate, one sigma per axis
    routines: tuple[str, ...]
    frames: int  # grabbed until it was found


def look_at(rig: Rig, look: Look, on_failure: Sequence[OnFailure] = ()) -> Sighting:
    """Measure a look's target and update the beliefs.

    Parameters
    ----------
    rig : Rig
        The running plan.
    look : Look
        What to look at, and how.
    on_failure : sequence of OnFailure
        How often a failure's code, or the routine's own, may be tried again. Every
        try takes the view's next focus stop, and each stop is tried once at least.

    Raises
    ------
    ExecutorError
        MP820..MP823 when the tries are used up.
    """
    tries = 0
    while True:
        tries += 1
        try:
            sighting = _sight(rig, look, tries)
        except ExecutorError as error:
            rig.journal.write("not_seen", look=look.id, code=error.code, why=str(error))
            further = len(look.view.focus_stops_um)
            if tries > max(_retries(error, on_failure), further):
                raise
            continue
        rig.beliefs.update(
            look.target,
            rig.readings(),
            sighting.x_um,
            sighting.y_um,
            sighting.theta_rad,
        )
        rig.journal.write("seen", look=look.id, at=sighting)
        if rig.watch is not None:
            rig.watch(look.target, sighting.x_um, sighting.y_um)
        return sighting


def to_unit(counts: Counts, bits: int) -> FloatArray:
    """Return counts as 0..1 of full scale, float64."""
    unit: FloatArray = counts / float(2**bits - 1)
    return unit


def _retries(error: ExecutorError, on_failure: Sequence[OnFailure]) -> int:
    """Return how often this failure may be tried again."""
    codes = (error.code, error.cause)
    return max(
        (f.times for f in on_failure if f.do == "retry" and f.code in codes), default=0
    )


def _sight(rig: Rig, look: Look, tries: int) -> Sighting:
    """Look once: the chain, then the fallback if the chain fails aloud."""
    rig.journal.write("look", look=look.id, target=look.target)
    stops = (look.view.focus_um, *look.view.focus_stops_um)
    rig.set_view(look.view, focus_um=stops[(tries - 1) % len(stops)])
    counts = rig.grab(look.measure.region)
    image = to_unit(counts, rig.plan.requirements.bits)
    try:
        return _measure(rig, look, look.measure.chain, image, tries)
    except ExecutorError as error:
        if not look.measure.fallback:
            raise
        rig.journal.write("fallback", look=look.id, code=error.code, why=str(error))
        return _measure(rig, _spare(look), look.measure.fallback, image, tries)


def _spare(look: Look) -> Look:
    """Return the look as its fallback measures it: with that chain's bias and gate."""
    measure = look.measure
    gates = replace(measure.gates, min_score=measure.fallback_min_score)
    return replace(
        look,
        measure=replace(measure, bias_um=measure.fallback_bias_um, gates=gates),
    )


def _measure(
    rig: Rig, look: Look, uses: Sequence[RoutineUse], image: FloatArray, tries: int
) -> Sighting:
    """Run one chain on the image and pass its answer through the gates."""
    expected = rig.beliefs.world(look.target, rig.readings())
    reference = look.measure.reference
    known = rig.beliefs.knows_angle(look.target)
    start = Guess(
        column=reference.column,
        row=reference.row,
        theta_rad=expected.theta_rad if known else None,
    )
    found = measure_chain(image, rig.artifacts.stages(look.id, uses), start)
    if isinstance(found, Failure):
        raise ExecutorError(
            "MP820",
            f"look {look.id}: {look.target} not found ({found.code}): {found.message}",
            cause=found.code,
        )
    theta_rad = start.theta_rad if found.theta_rad is None else found.theta_rad
    sighting = _to_world(rig, look, found, theta_rad, uses, tries)
    _pass_gates(look, sighting, expected)
    return sighting


def _to_world(
    rig: Rig,
    look: Look,
    found: Measurement,
    theta_rad: float | None,
    uses: Sequence[RoutineUse],
    tries: int,
) -> Sighting:
    """Turn pixels into um and take off the mean error the trials showed.

    That error is fixed in the target's frame: at an unknown angle it stays.
    """
    x_um, y_um = rig.frame_of(look).to_world(found.column, found.row)
    bias_x_um, bias_y_um = 0.0, 0.0
    if theta_rad is not None:
        turn = Pose(x_um=0.0, y_um=0.0, theta_rad=theta_rad)
        bias_x_um, bias_y_um = turn.apply(*look.measure.bias_um)
    return Sighting(
        target=look.target,
        x_um=x_um - bias_x_um,
        y_um=y_um - bias_y_um,
        theta_rad=found.theta_rad,
        score=found.score,
        spread_um=found.spread_px * look.view.um_per_px,
        routines=tuple(use.id for use in uses),
        frames=tries,
    )


def _pass_gates(look: Look, found: Sighting, expected: Pose) -> None:
    """Raise unless score, place and angle are what they should be."""
    gates: Gates = look.measure.gates
    if not found.score >= gates.min_score:  # also refuses nan
        raise ExecutorError(
            "MP821",
            f"look {look.id}: {look.target} scored {found.score:.3g}, "
            f"needs {gates.min_score:.3g}",
        )
    shift_um = math.hypot(found.x_um - expected.x_um, found.y_um - expected.y_um)
    if not shift_um <= gates.max_shift_um:
        raise ExecutorError(
            "MP822",
            f"look {look.id}: {look.target} found {shift_um:.3g} um from where it "
            f"was expected, at most {gates.max_shift_um:.3g} um",
        )
    if gates.max_turn_rad is None or found.theta_rad is None:
        return
    turn_rad = abs(math.remainder(found.theta_rad - expected.theta_rad, 2 * math.pi))
    if not turn_rad <= gates.max_turn_rad:
        raise ExecutorError(
            "MP823",
            f"look {look.id}: {look.target} found turned {turn_rad:.3g} rad, "
            f"at most {gates.max_turn_rad:.3g} rad",
        )
