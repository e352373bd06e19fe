"""Gates on pictures of a twin: right answers accepted, windows without it refused."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.real.twin_pictures import (
    CONDITIONS,
    NEAR,
    WRONG,
    ZOOM,
    Condition,
    pictures,
    write_task,
    wrong,
)
from microplan.featuresel.trials.chains import Chain
from microplan.planner.measure.measuring import PictureSeries
from microplan.planner.measure.near import parse_near
from microplan.planner.measure.part_series import part_series
from microplan.planner.measure.part_task import PartCall

CHAINS: tuple[Chain, ...] = (
    ("contour_match",),
    ("contour_match", "ecc"),
    ("contour_match", "likelihood"),
    ("ncc", "ecc"),
)
PICTURES = 12  # of each condition and each wrong part
_RIGHT = 4.0  # standard deviations, trueness among them


def _measure(_: Options) -> Iterator[Figure]:
    with TemporaryDirectory() as name:
        folder = Path(name)
        drawing, cell = write_task(folder)
        for chain in CHAINS:
            call = PartCall(
                part=drawing, workcell=cell, magnification=ZOOM, near=parse_near(NEAR)
            )
            series = part_series(call, chain=chain)
            own = folder / "-".join(chain)
            own.mkdir()
            yield from _figures(series, own, ".".join(chain))


def _figures(series: PictureSeries, folder: Path, name: str) -> Iterator[Figure]:
    """Yield the shares of one chain, and print them by condition."""
    found = [
        (label, *_shares(series, folder / f"right {label}", condition))
        for label, condition in CONDITIONS.items()
    ]
    false = [
        (label, *_shares(series, folder / f"wrong {label}", wrong(shape)))
        for label, shape in WRONG.items()
    ]
    for label, passed, right in found:
        print(f"{name}, {label}: {passed:.0%} accepted, {right:.0%} right")
    for label, passed, _ in false:
        print(f"{name}, without it, {label}: {passed:.0%} accepted")
    means = {
        "gates_passed": [passed for _, passed, _ in found],
        "right": [right for _, _, right in found],
        "false_passed": [passed for _, passed, _ in false],
    }
    for what, shares in means.items():
        mean = sum(shares) / len(shares)
        yield Figure(name=f"real.{what}.{name}", value=mean, unit="1")


def _shares(
    series: PictureSeries, folder: Path, condition: Condition
) -> tuple[float, float]:
    """Return the shares of pictures that are accepted, and whose answer is right."""
    truth = dict(pictures(folder, condition, PICTURES))
    passed = right = 0
    for found in series.measured(sorted(truth)):
        passed += found.is_accepted
        if found.x_um is None or found.y_um is None:
            continue
        off_um = math.dist((found.x_um, found.y_um), truth[found.path])
        sigma_um = math.hypot(
            found.repeatability_um or 0.0, series.look.trueness_um or 0.0
        )
        right += off_um <= _RIGHT * sigma_um
    return passed / PICTURES, right / PICTURES


BENCHMARK = Benchmark(
    names=tuple(
        f"real.{what}.{'.'.join(chain)}"
        for chain in CHAINS
        for what in ("gates_passed", "right", "false_passed")
    ),
    measure=_measure,
)
