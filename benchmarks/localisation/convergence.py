"""How near the likelihood fit comes to the Cramer-Rao limit: all points, resumably.

`python -m benchmarks.localisation.convergence` measures every scene, condition and
height and prints a table; what is measured is recorded, and a run that was stopped goes
on. `python -m benchmarks localisation` measures a sample in minutes. Truth is another
blur law than the estimator's (`benchmarks.localisation.scenes`); bias counts in the
rms; the limit is of the same free numbers, in the same light, behind the same fingers.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy is loaded, so that times compare

from benchmarks.figures import Benchmark, Figure, Options  # noqa: E402
from benchmarks.localisation import depth as localisation_depth  # noqa: E402
from benchmarks.localisation import trials as localisation_trials  # noqa: E402
from benchmarks.localisation.points import (  # noqa: E402
    PART,
    TRIALS,
    WAYS,
    costs,
    lines,
    points,
    units,
)
from benchmarks.localisation.record import (  # noqa: E402
    RECORD,
    code_of,
    key_of,
    record,
    recorded,
)
from benchmarks.localisation.scenes import CONDITIONS, FITTED  # noqa: E402
from benchmarks.localisation.times import times  # noqa: E402
from benchmarks.localisation.trials import Part, Unit  # noqa: E402
from microplan.featuresel.routines.likelihood import (  # noqa: E402
    defocus_pair,
    likelihood,
)

# What `make bench` measures, one unit each.
SAMPLE = (
    ("likelihood", "gear", "plain", 0.0),
    ("likelihood", "gear", "plain", 10.0),
    ("likelihood", "gear", "all", 5.0),
    ("likelihood", "shaft", "plain", 5.0),
    ("likelihood", "fingers", "plain", 5.0),
    ("one_step", "gear", "plain", 5.0),
    ("pair", "gear", "plain", 0.0),
    ("pair", "gear", "plain", 5.0),
    ("pair_same", "gear", "plain", 5.0),
)
_CODE = {
    "likelihood": (localisation_trials, likelihood),
    "likelihood_same": (localisation_trials, likelihood),
    "one_step": (localisation_trials, likelihood),
    "pair": (localisation_depth, defocus_pair),
    "pair_same": (localisation_depth, defocus_pair),
}


def measure(unit: Unit) -> Part:
    """Return what the unit's trials gave."""
    if unit.way in localisation_depth.WAYS:
        return localisation_depth.measure_pair(unit)
    return localisation_trials.measure_single(unit)


def measure_all(
    wanted: Sequence[Unit], jobs: int, path: Path | None
) -> Iterator[tuple[Unit, Part]]:
    """Yield units as they are done, first those recorded; with no jobs these alone."""
    known = {} if path is None else recorded(path)
    codes = {unit.way: code_of(*_modules(unit.way)) for unit in wanted}
    keys = {unit: key_of(asdict(unit), codes[unit.way]) for unit in wanted}
    for unit in wanted:
        if keys[unit] in known:
            yield unit, _part(known[keys[unit]])
    left = [unit for unit in wanted if keys[unit] not in known]
    for unit, part in _worked(left, jobs):
        if path is not None:
            record(path, keys[unit], {**asdict(unit), **asdict(part)})
        yield unit, part


def _worked(left: Sequence[Unit], jobs: int) -> Iterator[tuple[Unit, Part]]:
    """Yield units as they are measured, in no order."""
    if jobs == 0:
        return
    if jobs == 1 or len(left) < 2:
        yield from map(_pair, left)
        return
    # spawned, as a process forked from one with threads may hang
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        yield from pool.imap_unordered(_pair, left)


def _pair(unit: Unit) -> tuple[Unit, Part]:
    return unit, measure(unit)


def _modules(way: str) -> tuple[str, str]:
    """Return the modules whose code a result depends on."""
    module, routine = _CODE[way]
    return module.__name__, routine.__name__


def _part(value: dict[str, Any]) -> Part:
    """Return a part as recorded."""
    kept: dict[str, Any] = {
        name: tuple(value[name]) if isinstance(value[name], list) else value[name]
        for name in Part.__dataclass_fields__
    }
    return Part(**kept)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure what is not recorded yet, and print tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.localisation.convergence"
    )
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--jobs", type=int, default=Options().jobs)
    parser.add_argument("--way", choices=WAYS, action="append")
    parser.add_argument("--scene", choices=list(FITTED), action="append")
    parser.add_argument("--condition", choices=CONDITIONS, action="append")
    parser.add_argument("--height", type=float, action="append", metavar="UM")
    parser.add_argument("--record", type=Path, default=RECORD)
    parser.add_argument("--show", action="store_true", help="only what is recorded")
    call = parser.parse_args(argv)
    wanted = [
        unit
        for unit in units(call.trials)
        if unit.way in (call.way or WAYS)
        and unit.scene in (call.scene or FITTED)
        and unit.condition in (call.condition or CONDITIONS)
        and (not call.height or unit.z_um in call.height)
    ]
    done = []
    for unit, part in measure_all(wanted, 0 if call.show else call.jobs, call.record):
        done.append((unit, part))
        print(f"{len(done)} of {len(wanted)}: {unit}", file=sys.stderr, flush=True)
    found = points(done)
    print("\n".join([*lines(found), *costs(found, TRIALS)]))
    return 0


def _sample() -> list[Unit]:
    """Return the units of `make bench`: the first ones of some points."""
    return [
        Unit(way=way, scene=scene, condition=condition, z_um=z, part=0, trials=PART)
        for way, scene, condition, z in SAMPLE
    ]


def _names(place: tuple[str, str, str, float]) -> list[str]:
    """Return the names of a sampled point's figures."""
    way, scene, condition, z_um = place
    words = ["localisation", scene, f"z{z_um:g}", condition, way]
    ends = ["ratio_z", "bias_z_um"]
    if way not in localisation_depth.WAYS:
        ends = ["ratio_x", "ratio_y"] + ["ratio_theta"] * (scene != "shaft")
    return [".".join((*words, end)) for end in (*ends, "failed", "silent")]


_TIMES = ("warm_ms", "cold_ms", "step_ms")


def _measure(options: Options) -> Iterator[Figure]:
    """Measure times, then the sample's points.

    Raises
    ------
    ValueError
        If nothing is right at one: there is no rms then.
    """
    taken = times()
    for point in points(list(measure_all(_sample(), options.jobs, None))):
        names = _names((point.way, point.scene, point.condition, point.z_um))
        values = [*point.ratios, *(point.bias if len(point.rms) == 1 else ())]
        values += [n / point.trials for n in (point.failed, point.silent)]
        for name, value in zip(names, values, strict=True):
            yield Figure(name=name, value=value, unit="um" if "_um" in name else "1")
    for name in _TIMES:
        yield Figure(
            name=f"localisation.gear.{name}",
            value=getattr(taken, name),
            unit="ms",
            floor=taken.floor_ms,
        )


BENCHMARK = Benchmark(
    names=(
        *(name for place in SAMPLE for name in _names(place)),
        *(f"localisation.gear.{name}" for name in _TIMES),
    ),
    measure=_measure,
)

if __name__ == "__main__":
    sys.exit(main())
