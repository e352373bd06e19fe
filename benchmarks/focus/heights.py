"""Heights by a focus sweep and by a pair of pictures, on the simulated cell.

python -m benchmarks.focus.heights prints the table of docs/servo.md. The cell blurs by
another law than the pair was prepared with and by a wider aperture, its focus repeats
to .5 um and its sensor is noisy; the truth is the height of the gear's face there.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.localisation.scenes import gear
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.record.frames import Frames
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.focus_sweep import Height, height_by_pair, height_by_sweep
from microplan.executor.run.measure_target import TargetSighting
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.routines.contract import Artifact
from microplan.featuresel.routines.likelihood import defocus_pair
from microplan.schemas.plan import HeightSearch, Look, Region
from microplan.schemas.pose import Pose
from tests.executor.bench import plan_of, world
from tests.executor.disc import look as disc_look

SEEDS = 40
FACE_UM = 100.0
WITHIN_UM = 10.0  # of the face about its nominal height: uniform
PAIR_UM = 10.0
STOPS_UM = tuple(float(z) for z in np.linspace(70, 130, 19))
RING_UM = 50.0
WAYS = ("sweep", "pair", "two_pairs")
_NAMES = ("rms_um", "sigma_um", "seconds", "failed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """One height: what it is off by, what it says of itself, and its time."""

    error_um: float | None  # None: none was told
    sigma_um: float
    seconds: float


def answers(way: str, seeds: int = SEEDS, bias_um: float = 0.0) -> list[Answer]:
    """Return what a way tells of faces at drawn heights, poses and noise.

    Of a sweep the plan states the bias.
    """
    return [_answer(way, seed, bias_um) for seed in range(seeds)]


@cache
def pair_artifact() -> Artifact:
    """Return the pair's fit, prepared by the compiler's law."""
    case = gear()
    made = defocus_pair.prepare(nominal_render(case), case.target, offset_um=PAIR_UM)
    if not isinstance(made, Artifact):
        raise ValueError(made.message)
    return made


def _answer(way: str, seed: int, bias_um: float) -> Answer:
    """Return one height."""
    rng = np.random.default_rng([77, seed])
    cell = build_cell(world(), seed)
    body = cell.truth.bodies["gear"]
    x_um, y_um, theta_rad = *rng.uniform(-2, 2, 2), float(rng.uniform(-3, 3))
    body.pose = Pose(x_um=600.0 + x_um, y_um=y_um, theta_rad=theta_rad)
    cell.stage.move(z_um=float(rng.uniform(-WITHIN_UM, WITHIN_UM)))
    pose = cell.truth.pose(body)
    part = TargetSighting(
        target="gear", x_um=pose.x_um, y_um=pose.y_um, theta_rad=pose.theta_rad,
        score=1.0, spread_um=0.1, sigma_theta_rad=None, routines=(), frames=1,
        features={},
    )  # fmt: skip
    rig, look = _rig(cell), _look()
    try:
        found = _height(way, rig, look, part, bias_um)
    except ExecutorError:
        return Answer(error_um=None, sigma_um=0.0, seconds=0.0)
    return Answer(
        error_um=found.z_um - cell.truth.top_um(body),
        sigma_um=found.sigma_um,
        seconds=found.seconds,
    )


def _height(
    way: str, rig: Rig, look: Look, part: TargetSighting, bias_um: float
) -> Height:
    """Return a height by one way."""
    if way == "sweep":
        search = HeightSearch(
            look=look.id, expected_um=FACE_UM, within_um=WITHIN_UM,
            focus_um=STOPS_UM, ring_radius_um=RING_UM, bias_um=bias_um,
        )  # fmt: skip
        return height_by_sweep(rig, search, look, part)
    fit = pair_artifact()
    first = height_by_pair(rig, look, part, fit, expected_um=FACE_UM, offset_um=PAIR_UM)
    if way == "pair":
        return first
    second = height_by_pair(
        rig, look, part, fit, expected_um=first.z_um, offset_um=PAIR_UM
    )
    return replace(second, seconds=first.seconds + second.seconds)


def _rig(cell: Cell) -> Rig:
    """Return a rig around a cell."""
    plan, station = plan_of(()), cell.station
    return Rig(
        plan=plan,
        station=station,
        beliefs=Beliefs(plan.beliefs, plan.features),
        artifacts=Artifacts({}),
        journal=Journal(io.StringIO(), station.clock),
        frames=Frames(None),
    )


def _look() -> Look:
    """Return a look at the gear whose region is that of the pair's fit."""
    case, found = gear(), disc_look()[0]
    scope, window = case.microscope, case.window
    view = replace(
        found.view,
        magnification=scope.magnification,
        um_per_px=scope.um_per_px,
        field_um=scope.field_um,
        focus_um=FACE_UM,
    )
    region = Region(
        row=window.row, column=window.column, rows=window.rows, columns=window.columns
    )
    return replace(found, view=view, measure=replace(found.measure, region=region))


def _measure(_options: Options) -> Iterator[Figure]:
    for way in WAYS:
        found = answers(way)
        good = [a for a in found if a.error_um is not None]
        errors = np.array([a.error_um for a in good])
        values = (
            float(np.sqrt(np.mean(errors**2))),
            float(np.median([a.sigma_um for a in good])),
            float(np.median([a.seconds for a in good])),
            1 - len(good) / len(found),
        )
        for name, value in zip(_NAMES, values, strict=True):
            unit = {"rms_um": "um", "sigma_um": "um", "seconds": "s"}.get(name, "1")
            yield Figure(name=f"heights.{way}.{name}", value=value, unit=unit)


BENCHMARK = Benchmark(
    names=tuple(f"heights.{way}.{name}" for way in WAYS for name in _NAMES),
    measure=_measure,
)


def main() -> int:
    """Print the table."""
    print("| way | " + " | ".join(_NAMES) + " |\n|" + "---|" * 5)
    figures = iter(_measure(Options()))
    for way in WAYS:
        row = [f"{next(figures).value:.3g}" for _ in _NAMES]
        print(f"| {way} | " + " | ".join(row) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
