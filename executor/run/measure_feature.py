"""Measurement of one feature of a look: routines, gates, bias, pixels to um."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from microplan.arrays import FloatArray
from microplan.executor.devices.calibration import LookFrame
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.run.artifacts import Artifacts, Stages, answer_of, key_of
from microplan.executor.run.gates import gates_of
from microplan.executor.run.run_context import Rig
from microplan.executor.run.warm_start import (
    FoundFeature,
    WarmStart,
    guess_from,
    nearest_routine,
)
from microplan.featuresel.routines.contract import Failure, Guess, Measurement
from microplan.featuresel.routines.fusion import Believed, SeenFeature
from microplan.schemas.plan import Look, Measure, RoutineUse
from microplan.schemas.pose import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A frame's region, and what was believed when it was taken."""

    image: FloatArray  # (rows, columns), 0..1 of full scale
    frame: LookFrame  # of the region
    expected: Pose  # of the look's target, world
    believed: Believed | None  # the part's angle, None if nothing is known of it
    # what a look just before found, a correction ago
    warm_start: WarmStart | None = None
    trusted: bool = True  # whether to begin at what is expected


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownFeature:
    """A feature as one picture shows it, and how surely."""

    seen: SeenFeature
    score: float
    spread_um: float  # the routine's own estimate, one sigma per axis
    routines: tuple[str, ...]
    pixels: Measurement  # measured by the last of them, in the picture's region
    frame: LookFrame  # of that region

    @property
    def found(self) -> FoundFeature:
        """Return the start of a look after a small correction."""
        x_um, y_um, pixels = self.seen.x_um, self.seen.y_um, self.pixels
        column, row = self.frame.to_pixel(x_um, y_um)
        bias_px = (pixels.column - column, pixels.row - row)
        return FoundFeature(x_um=x_um, y_um=y_um, pixels=pixels, bias_px=bias_px)


def look_for(rig: Rig, look: Look, measure: Measure, picture: Picture) -> ShownFeature:
    """Return the position of a feature in a picture: its chain, then the fallback.

    Where a look just before has found it, the end of the chain alone comes first.

    Raises
    ------
    ExecutorError
        MP820 if no routine finds it; MP821..MP823, MP825 if an answer fails a gate.
    """
    if (shown := _from_warm_start(rig, look, measure, picture)) is not None:
        return shown
    try:
        return _accepted(rig, look, measure, measure.chain, picture)
    except ExecutorError as error:
        if not measure.fallback:
            raise
        rig.journal.write("fallback", look=look.id, code=error.code, why=str(error))
        try:
            return _accepted(rig, look, spare(measure), measure.fallback, picture)
        except ExecutorError as other:
            other.append(f"its chain, before the fallback: {error.message}")
            raise


def spare(measure: Measure) -> Measure:
    """Return the measurement by the fallback: that chain's bias, sigma and gate.

    The gate of sigma is the first chain's own.
    """
    gates = replace(
        measure.gates, min_score=measure.fallback_min_score, max_spread_um=None
    )
    return replace(
        measure,
        bias_um=measure.fallback_bias_um,
        sigma_xy_um=measure.fallback_sigma_xy_um or measure.sigma_xy_um,
        sigma_theta_rad=measure.fallback_sigma_theta_rad,
        gates=gates,
    )


def _accepted(
    rig: Rig, look: Look, measure: Measure, uses: Sequence[RoutineUse], picture: Picture
) -> ShownFeature:
    """Run one chain on the image and pass its answer through the gates."""
    shown = measured(rig.artifacts, look, measure, uses, picture)
    name = measure.feature or look.target
    _pass_gates(f"look {look.id}: {name}", measure, shown, picture)
    return shown


def measured(
    artifacts: Artifacts,
    look: Look,
    measure: Measure,
    uses: Sequence[RoutineUse],
    picture: Picture,
) -> ShownFeature:
    """Return the answer of one chain, before any gate.

    It starts where the feature is believed to be, not where the plan's own picture has
    it: tools land elsewhere, and what is aligned to them goes along. Where the belief
    is what is in doubt it starts in the middle of what the plan searches.

    Raises
    ------
    ExecutorError
        MP820 if it finds nothing.
    """
    start_px = (measure.reference.column, measure.reference.row)
    if picture.trusted:
        at_um = picture.expected.apply(*measure.offset_um)
        start_px = picture.frame.to_pixel(*at_um)
    column, row = start_px
    start = Guess(
        column=column,
        row=row,
        theta_rad=picture.expected.theta_rad + measure.turn_rad
        if picture.believed is not None
        else None,
        theta_assumed=True,
    )
    stages = artifacts.stages(key_of(look, measure), uses)
    return _answer(look, measure, stages, start, picture)


def _from_warm_start(
    rig: Rig, look: Look, measure: Measure, picture: Picture
) -> ShownFeature | None:
    """Return what the end of the chain finds where the feature must be, if anything."""
    name, warm_start = measure.feature or look.target, picture.warm_start
    before = None if warm_start is None else warm_start.features.get(name)
    if warm_start is None or before is None:
        return None
    routine = nearest_routine(measure.chain, warm_start, before, look.view.um_per_px)
    if routine is None:
        return None
    guess = guess_from(
        before,
        picture.frame.to_pixel(*picture.expected.apply(*measure.offset_um)),
        picture.expected.theta_rad + measure.turn_rad,
    )
    ((_, arrays),) = rig.artifacts.stages(key_of(look, measure), measure.chain[-1:])
    try:
        shown = _answer(look, measure, [(routine, arrays)], guess, picture)
        _pass_gates(f"look {look.id}: {name}", measure, shown, picture)
        return shown
    except ExecutorError as error:
        rig.journal.write("not_near", look=look.id, code=error.code, why=str(error))
        return None


def _answer(
    look: Look,
    measure: Measure,
    stages: Stages,
    start: Guess,
    picture: Picture,
) -> ShownFeature:
    """Return what routines find from `start`, before any gate."""
    name = measure.feature or look.target
    try:
        found = answer_of(picture.image, stages, start)
    except ExecutorError as error:
        raise ExecutorError(
            error.code, f"look {look.id}: {name}: {error.message}"
        ) from error
    if isinstance(found, Failure):
        raise ExecutorError(
            "MP820",
            f"look {look.id}: {name} not found ({found.code}): {found.message}",
            cause=found.code,
        )
    shown = _shown(look, measure, found, picture)
    return replace(shown, routines=tuple(routine for routine, _ in stages))


def _shown(
    look: Look, measure: Measure, found: Measurement, picture: Picture
) -> ShownFeature:
    """Convert pixels to um and subtract the mean error that the trials showed.

    That error is fixed in the part's frame: at an unknown angle it stays.
    """
    theta_rad = None if picture.believed is None else picture.believed.theta_rad
    if found.theta_rad is not None:
        theta_rad = found.theta_rad - measure.turn_rad
    x_um, y_um = picture.frame.to_world(found.column, found.row)
    if theta_rad is not None:
        turn = Pose(x_um=0.0, y_um=0.0, theta_rad=theta_rad)
        bias = turn.apply(*measure.bias_um)
        x_um, y_um = x_um - bias[0], y_um - bias[1]
    return ShownFeature(
        seen=SeenFeature(
            x_um=x_um,
            y_um=y_um,
            sigma_um=measure.sigma_xy_um,
            offset_um=measure.offset_um,
            axis_rad=found.axis_rad,
            theta_rad=None if found.theta_rad is None else theta_rad,
            sigma_theta_rad=measure.sigma_theta_rad,
        ),
        score=found.score,
        spread_um=found.spread_px * look.view.um_per_px,
        routines=(),
        pixels=found,
        frame=picture.frame,
    )


def _pass_gates(
    name: str, measure: Measure, shown: ShownFeature, picture: Picture
) -> None:
    """Raise unless score, sigma, position and angle pass their gates."""
    for gate in gates_of(
        measure, shown.score, shown.spread_um, shown.seen, picture.expected
    ):
        if not gate.passed:
            raise ExecutorError(gate.code, f"{name} {gate.words}")
