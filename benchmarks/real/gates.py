"""Gates on pictures of twins: right answers accepted, windows without them refused."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.real.twin_parts import PARTS, TwinPart
from benchmarks.real.twin_pictures import (
    CONDITIONS,
    NEAR,
    TOGETHER,
    ZOOM,
    disc_middle_um,
    write_part,
    write_pictures,
)
from microplan.featuresel.trials.chains import Chain
from microplan.planner.measure.measuring import PictureSeries
from microplan.planner.measure.near import parse_near
from microplan.planner.measure.part_series import part_series
from microplan.planner.measure.part_task import PartCall
from validation.twins.series import Pose

CHAINS: tuple[Chain, ...] = (
    ("contour_match",),
    ("contour_match", "ecc"),
    ("contour_match", "likelihood"),
    ("ncc", "ecc"),
)
RIGHT, WRONG = 12, 38  # pictures of each condition, and of each other thing
_SIGMAS = 4.0  # standard deviations, trueness among them, that are right

Pictures = Mapping[str, Mapping[Path, Pose]]  # by what they show


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shares:
    """Shares of pictures, 0..1."""

    accepted: float
    right: float


def _measure(_: Options) -> Iterator[Figure]:
    with TemporaryDirectory() as name:
        for label, part in PARTS.items():
            yield from _part_figures(label, part, Path(name) / label)


def _part_figures(label: str, part: TwinPart, folder: Path) -> Iterator[Figure]:
    """Yield the shares of one part by all chains."""
    folder.mkdir()
    drawing, cell = write_part(folder, part.shape)
    call = PartCall(
        part=drawing, workcell=cell, magnification=ZOOM, near=parse_near(NEAR)
    )
    right = {
        name: dict(write_pictures(folder / f"right {name}", part.shape, how, RIGHT))
        for name, how in CONDITIONS.items()
    }
    wrong = {
        name: dict(write_pictures(folder / f"wrong {name}", shape, TOGETHER, WRONG))
        for name, shape in part.wrong.items()
    }
    for chain in CHAINS:
        series = part_series(call, chain=chain)
        yield from _figures(series, right, wrong, f"{label}.{'.'.join(chain)}")


def _figures(
    series: PictureSeries, right: Pictures, wrong: Pictures, name: str
) -> Iterator[Figure]:
    """Yield the shares of one part and chain, and print them by condition."""
    found = {
        label: _shares(series, truth, _shown_um(label))
        for label, truth in right.items()
    }
    false = {
        label: _shares(series, truth, (0.0, 0.0)) for label, truth in wrong.items()
    }
    for label, each in found.items():
        print(f"{name}, {label}: {each.accepted:.0%} accepted, {each.right:.0%} right")
    for label, each in false.items():
        print(f"{name}, without it, {label}: {each.accepted:.0%} accepted")
    means = {
        "gates_passed": [each.accepted for each in found.values()],
        "right": [each.right for each in found.values()],
        "false_passed": [each.accepted for each in false.values()],
    }
    for what, shares in means.items():
        mean = sum(shares) / len(shares)
        yield Figure(name=f"real.{what}.{name}", value=mean, unit="1")


@cache
def _shown_um(label: str) -> tuple[float, float]:
    """Return where a condition's lens shows the middle of a large disc in focus, um.

    By its own pictures: a calibrated camera takes it off.
    """
    lens = CONDITIONS[label].lens
    if not lens.zernike:
        return 0.0, 0.0
    off = disc_middle_um(lens) - disc_middle_um(replace(lens, zernike={}))
    return float(off[0]), float(off[1])


def _shares(
    series: PictureSeries, truth: Mapping[Path, Pose], shown_um: tuple[float, float]
) -> _Shares:
    """Return the shares that are accepted, and whose answer is right."""
    accepted = right = 0
    for found in series.measured(sorted(truth)):
        accepted += found.is_accepted
        if found.x_um is None or found.y_um is None:
            continue
        pose = truth[found.path]
        there_um = (pose.x_um + shown_um[0], pose.y_um + shown_um[1])
        off_um = math.dist((found.x_um, found.y_um), there_um)
        sigma_um = math.hypot(
            found.repeatability_um or 0.0, series.look.trueness_um or 0.0
        )
        right += off_um <= _SIGMAS * sigma_um
    return _Shares(accepted=accepted / len(truth), right=right / len(truth))


BENCHMARK = Benchmark(
    names=tuple(
        f"real.{what}.{part}.{'.'.join(chain)}"
        for part in PARTS
        for chain in CHAINS
        for what in ("gates_passed", "right", "false_passed")
    ),
    measure=_measure,
)
