"""Calibrations from series of twins: pulls against their truth, and the time."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from scipy.stats import chi2, norm, t
from shapely.geometry import Polygon, box

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.real.twin_pictures import SIZE, UM_PER_PX, ZOOM, write_part
from microplan.planner.calibration.calibrated_cell import (
    CalibrateCall,
    calibrated,
    first_of_each,
)
from microplan.planner.calibration.calibrated_value import CalibratedValue
from microplan.planner.measure.near import parse_near
from microplan.planner.measure.part_task import PartCall
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.schema import Checked, check
from microplan.planner.source.source import read_source
from microplan.planner.store.memo import Memo
from microplan.planner.store.store import Store
from validation.twins.camera import Camera, exposed
from validation.twins.optics import Optics, image
from validation.twins.scenes import Body, Floats, Scene, square_with_notch
from validation.twins.series import Frame, Pose, Reading, Rig, write

SEEDS = {"light": 40, "stage": 8, "focus": 8}  # series: those of lights are quick
_PICTURES = 60  # of the series that is timed
_NEAR = "159px,119px,0"
_PART = Polygon(
    square_with_notch(44.0, 12.0).exterior, [box(-10.0, -12.0, 9.0, 8.0).exterior]
)
_CAMERA = Camera(gain=1.05, full_well=20_000.0, read_noise=1.0)
_LENS = Optics(aperture=0.42, wavelength_um=0.6)
_STOPS = [(x, y) for x in (-18.0, -6.0, 6.0, 18.0) for y in (-8.0, 0.0, 8.0)]
KINDS = ("light", "stage", "focus", "wavefront")
_ABERRATIONS = ((), (6, 7, 8, 11), (8, 11), (5, 6, 7, 8, 9, 10, 11))  # by seed
_UNTOLD = 1e-3  # waves: the pull of a term that was put in and not found is over that
_FINER = 4  # pixels a side of a pixel, at which focus series are imaged


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationTruth:
    """Numbers that a series was made with, by key, and what errs independently."""

    values: Mapping[str, float]
    free: int  # blocks of the jackknife less numbers fitted
    zernike: Mapping[int, float] = field(default_factory=dict)  # Noll: waves rms


@dataclass(slots=True, kw_only=True)
class CalibrationBench:
    """A part, its workcell, and how it is calibrated."""

    folder: Path
    drawing: Path
    cell: Path
    memo: Memo
    pulls: dict[str, list[float]] = field(default_factory=dict)

    def found(self, pictures: Path) -> Sequence[CalibratedValue]:
        """Return what a series tells; RuntimeError if it is refused."""
        report = Report()
        part = PartCall(
            part=self.drawing, workcell=self.cell, magnification=ZOOM,
            near=parse_near(_NEAR),
        )  # fmt: skip
        call = CalibrateCall(
            pictures=[pictures], cell=_checked(self.cell, report), bits=None,
            part=part, memo=self.memo,
        )  # fmt: skip
        series = calibrated(call, report)
        if report.failed:
            raise RuntimeError(str(report.found[0]))
        return list(first_of_each(series, Span(file="twin"), report))

    def judge(self, kind: str, pictures: Path, truth: CalibrationTruth) -> None:
        """Take the pulls of one series, as a normal distribution would have them."""
        found = {value.key: value for value in self.found(pictures)}
        for key, true in truth.values.items():
            one = found[key]
            sigma = one.sigma[0]
            if sigma and isinstance(one.value, float):  # else a table has no pull
                pull = (one.value - true) / sigma
                print(f"{kind} {key}: {one.value:.6g} +- {sigma:.2g}, {pull:+.2f}")
                self._take(kind, pull, truth.free)
        if kind == "focus":
            self._judge_wavefront(found.get("wavefront"), truth)

    def _judge_wavefront(
        self, found: CalibratedValue | None, truth: CalibrationTruth
    ) -> None:
        """Take the pulls of aberrations: those put in, and others that were told."""
        told: dict[int, tuple[float, float]] = {}
        if found is not None and not isinstance(found.value, float):
            for (noll, waves), sigma in zip(found.value, found.sigma, strict=True):
                told[int(noll)] = waves, sigma or math.inf
        for noll in sorted({*told, *truth.zernike}):
            waves, sigma = told.get(noll, (0.0, _UNTOLD))
            pull = (waves - truth.zernike.get(noll, 0.0)) / sigma
            print(f"focus Noll {noll}: {waves:.5f} +- {sigma:.2g}, {pull:+.2f}")
            self._take("wavefront", pull, truth.free)

    def _take(self, kind: str, pull: float, free: int) -> None:
        """Keep a pull as a normal distribution would have it."""
        normal = float(norm.ppf(t.cdf(pull, free)))
        self.pulls.setdefault(kind, []).append(normal)


def _checked(cell: Path, report: Report) -> Checked:
    source = read_source(cell, str(cell), report, Span(file=str(cell)))
    if source is None:
        raise RuntimeError(f"{cell} cannot be read")
    return check(source, "workcell", "microplan_workcell", report)


def _rig(lens: Optics) -> Rig:
    return Rig(
        part=(Body(shape=_PART, reflectance=0.8),),
        surroundings=Scene(bodies=(), background=0.1),
        optics=lens, camera=_CAMERA, size=SIZE, um_per_px=UM_PER_PX,
    )  # fmt: skip


@cache
def _chart() -> Floats:
    """Return the light of eight patches from dark to bright."""
    shades = np.random.default_rng(3).uniform(0.05, 1.0, 8).tolist()
    places = [(28.0 * i - 56, 42.0 * j - 42) for i in range(4) for j in range(2)]
    patches = tuple(
        Body(shape=box(x, y, x + 26, y + 38), reflectance=shade)
        for shade, (x, y) in zip(shades, places, strict=True)
    )
    return image(Scene(bodies=patches, background=0.02), _LENS, SIZE, UM_PER_PX)


def _light_series(folder: Path, seed: int) -> CalibrationTruth:
    """Write patches in ten lights whose readings err by .3 %."""
    rng = np.random.default_rng([seed, 1])
    gamma, black = ((1.0, 8.0), (0.7, 12.0), (0.5, 4.0), (1.4, 10.0))[seed % 4]
    camera = replace(_CAMERA, gamma=gamma, black=black, gain=1.0)
    light, shots = _chart(), []
    for reading in np.geomspace(0.12, 1.15, 10).tolist():
        true = reading * (1 + rng.normal(0, 0.003))
        for _ in range(4):
            counts = exposed(light * true, camera, rng)
            shots.append(
                Frame(counts=counts, truth=Pose(), reading=Reading(light=reading))
            )
    write(folder, shots, bits=8)
    return CalibrationTruth(values={"response": gamma, "black_level": black}, free=8)


def _stage_series(folder: Path, seed: int) -> CalibrationTruth:
    """Write the part at twelve stops of a stage that errs by .05 um."""
    rng = np.random.default_rng([seed, 2])
    across, up = rng.uniform(-0.2, 0.2, 2).tolist()
    rig, shots = replace(_rig(_LENS), gradient=(across, up)), []
    scale = 1 + 0.002 * (seed - 3)
    for x, y in _STOPS:
        slip = rng.normal(0, 0.05, 2)
        pose = Pose(x_um=scale * x + float(slip[0]), y_um=scale * y + float(slip[1]))
        counts = exposed(rig.light(pose, 0.0), rig.camera, rng)
        reading = Reading(stage_x_um=x, stage_y_um=y)
        shots.append(Frame(counts=counts, truth=pose, reading=reading))
    write(folder, shots, bits=8)
    pitch = {"pitch_x_um": UM_PER_PX, "pitch_y_um": UM_PER_PX, "skew_rad": 0.0}
    by_stage = UM_PER_PX / scale
    others = {
        "pitch_x_by_stage_um": by_stage, "pitch_y_by_stage_um": by_stage,
        "stage_scale_x": scale, "stage_scale_y": scale, "stage_skew_rad": 0.0,
        "light_gradient_x": across, "light_gradient_y": up,
    }  # fmt: skip
    return CalibrationTruth(values=pitch | others, free=9)


def _focus_series(folder: Path, seed: int) -> CalibrationTruth:
    """Write the part at eleven focus readings of another lens."""
    rng = np.random.default_rng([seed, 3])
    aperture = 0.42 * (1 + 0.02 * (seed - 3))
    zero_um, scale = float(rng.uniform(-0.8, 0.8)), 1 + 0.01 * (seed % 3 - 1)
    zernike = {noll: float(rng.normal(0, 0.02)) for noll in _ABERRATIONS[seed % 4]}
    rig = _rig(replace(_LENS, aperture=aperture, zernike=zernike))
    turn, shots = float(rng.uniform(-0.05, 0.05)), []
    for z_um in np.linspace(-5.0, 5.0, 11).tolist():
        light = _finely_imaged(rig, Pose(theta_rad=turn), scale * (z_um - zero_um))
        reading = Reading(focus_um=z_um)
        counts = exposed(light, rig.camera, rng)
        shots.append(Frame(counts=counts, truth=Pose(), reading=reading))
    write(folder, shots, bits=8)
    values = {"numerical_aperture": aperture, "focus_zero_um": zero_um}
    return CalibrationTruth(
        values=values | {"focus_scale": scale}, free=8, zernike=zernike
    )


def _finely_imaged(rig: Rig, pose: Pose, focus_um: float) -> Floats:
    """Return light as `Rig.light`, (rows, columns), of images made `_FINER` as fine.

    As twins are made by themselves, they err by as much as a lens of an aperture .1 %
    off: more than such pictures tell.
    """
    rows, columns = rig.size
    finer = replace(
        rig, size=(_FINER * rows, _FINER * columns), um_per_px=rig.um_per_px / _FINER
    )
    light = finer.light(pose, focus_um)
    found: Floats = light.reshape(rows, _FINER, columns, _FINER).mean(axis=(1, 3))
    return found


_WRITERS = {"light": _light_series, "stage": _stage_series, "focus": _focus_series}


def _measure(_: Options) -> Iterator[Figure]:
    with TemporaryDirectory() as name:
        folder = Path(name)
        drawing, cell = write_part(folder, _PART)
        _with_noise(cell)
        bench = CalibrationBench(
            folder=folder, drawing=drawing, cell=cell, memo=Memo(Store(folder / "kept"))
        )
        for kind, writer in _WRITERS.items():
            for seed in range(SEEDS[kind]):
                pictures = folder / f"{kind}{seed}"
                bench.judge(kind, pictures, writer(pictures, seed))
        for kind in KINDS:
            square = float(np.mean(np.square(bench.pulls[kind])))
            count = len(bench.pulls[kind])
            low, high = (float(chi2.ppf(p, count)) / count for p in (0.025, 0.975))
            print(f"{kind}: {square:.2f} of {count}, {low:.2f} to {high:.2f} by chance")
            yield Figure(name=f"real.pull_mean_square_{kind}", value=square, unit="1")
        yield Figure(name="real.calibrate_s", value=_timed(bench), unit="s")


def _with_noise(cell: Path) -> None:
    """State the twins' camera, as a calibration would have it."""
    data: dict[str, Any] = yaml.safe_load(cell.read_text(encoding="utf-8"))
    data["camera"] |= {"full_well_e": 20_000, "read_noise_e": 80}
    cell.write_text(yaml.safe_dump(data), encoding="utf-8")


def _timed(bench: CalibrationBench) -> float:
    """Return the time of a calibration by 60 pictures, nothing kept from before."""
    pictures, rig = bench.folder / "timed", _rig(_LENS)
    rng = np.random.default_rng(9)
    stops = [Reading(stage_x_um=x, stage_y_um=y) for x, y in _STOPS]
    lights = [rig.light(Pose(x_um=s.stage_x_um, y_um=s.stage_y_um), 0) for s in stops]
    shots = [
        Frame(counts=exposed(light, rig.camera, rng), truth=Pose(), reading=stop)
        for stop, light in zip(stops, lights, strict=True)
        for _ in range(_PICTURES // len(stops))
    ]
    write(pictures, shots, bits=8)
    bench.memo = Memo(Store(bench.folder / "none"))
    start = time.perf_counter()
    bench.found(pictures)
    return time.perf_counter() - start


BENCHMARK = Benchmark(
    names=(*(f"real.pull_mean_square_{kind}" for kind in KINDS), "real.calibrate_s"),
    measure=_measure,
)
