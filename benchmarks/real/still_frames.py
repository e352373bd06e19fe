"""Frames of a still part: how far answers scatter against what is said, and how long.

The camera's noise falls with the light, which the workcell does not know before
`calibrate` has seen the frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.real.gates import CHAINS
from benchmarks.real.twin_parts import PARTS
from benchmarks.real.twin_pictures import (
    ANGLE_RAD,
    CAMERA,
    FALLING,
    GROUND,
    LENS,
    PART,
    UM_PER_PX,
    ZOOM,
    write_part,
)
from benchmarks.timing import cpu_s
from microplan.featuresel.trials.chains import Chain
from microplan.planner.cli.main import main
from microplan.planner.measure.measuring import MeasuredPicture, PictureSeries
from microplan.planner.measure.near import parse_near
from microplan.planner.measure.part_series import part_series
from microplan.planner.measure.part_task import PartCall
from validation.twins.scenes import Body, Scene
from validation.twins.series import Pose, Rig, still, write

FRAMES = 100
_SIZE = (480, 640)
_NEAR = "319px,240px,10"
_TIMED: Chain = ("contour_match", "likelihood")
# stated of the lens in one of two timings: both sides of focus are fitted then
_TERMS = "[{noll: 5, waves: .01}, {noll: 8, waves: .01}, {noll: 11, waves: .01}]"


def _measure(_: Options) -> Iterator[Figure]:
    with TemporaryDirectory() as name:
        call, pictures = _prepared(Path(name))
        for chain in CHAINS:
            series = part_series(call, chain=chain)
            yield _ratio(list(series.measured(pictures)), chain)
        yield _time("real.measure_ms", part_series(call, chain=_TIMED), pictures)
        stated = part_series(_through_lens(call), chain=_TIMED)
        yield _time("real.measure_ms_wavefront", stated, pictures)


def _through_lens(call: PartCall) -> PartCall:
    """Return the same call with a workcell that states aberrations."""
    text = Path(call.workcell).read_text(encoding="utf-8")
    before, optics, after = text.partition("optics:\n")
    if not optics:
        raise RuntimeError(f"{call.workcell} has no block of optics")
    found = Path(call.workcell).with_name("lens.yaml")
    lines = f"{before}{optics}  wavefront: {_TERMS}\n{after}"
    found.write_text(lines, encoding="utf-8")
    return replace(call, workcell=found)


def _prepared(folder: Path) -> tuple[PartCall, list[Path]]:
    """Write pictures of a gear, and calibrate a workcell's camera by them."""
    shape = PARTS["gear"].shape
    drawing, cell = write_part(folder, shape, _SIZE)
    rig = Rig(
        part=(Body(shape=shape, reflectance=PART),),
        surroundings=Scene(bodies=(), background=GROUND),
        optics=LENS,
        camera=replace(CAMERA, noise_table=FALLING),
        size=_SIZE,
        um_per_px=UM_PER_PX,
    )
    pose = Pose(x_um=0.3, y_um=-0.2, theta_rad=ANGLE_RAD)
    taken = folder / "taken"
    write(taken, still(rig, pose, FRAMES), bits=8, ending=".png")
    pictures = sorted(taken.glob("*.png"))
    known = cell.with_name("known.yaml")
    said = StringIO()
    with redirect_stdout(said):
        status = main(
            [
                "calibrate",
                *map(str, pictures),
                "--workcell",
                str(cell),
                "-o",
                str(known),
            ]
        )
    if status:
        raise RuntimeError(said.getvalue())
    call = PartCall(
        part=drawing, workcell=known, magnification=ZOOM, near=parse_near(_NEAR)
    )
    return call, pictures


def _ratio(found: Sequence[MeasuredPicture], chain: Chain) -> Figure:
    """Return the scatter of answers over the standard deviation that they state."""
    at_um = np.array([(each.x_um, each.y_um) for each in found], dtype=np.float64)
    said_um = [each.repeatability_um for each in found if each.repeatability_um]
    scatter_um = float(np.sqrt(at_um.var(axis=0, ddof=1).mean()))
    return Figure(
        name=f"real.sigma_ratio.{'.'.join(chain)}",
        value=scatter_um / float(np.median(said_um)),
        unit="1",
    )


def _time(name: str, series: PictureSeries, pictures: Sequence[Path]) -> Figure:
    """Return the CPU time of a picture; the floor is reading its file."""
    first, *others = pictures
    list(series.measured([first]))  # what the first one loads
    work = cpu_s(lambda: list(series.measured(others)))
    floor = cpu_s(lambda: [cv2.imread(str(file), -1) for file in others])
    ms = 1e3 / len(others)
    return Figure(name=name, value=ms * work, unit="ms", floor=ms * floor)


BENCHMARK = Benchmark(
    names=(
        *(f"real.sigma_ratio.{'.'.join(chain)}" for chain in CHAINS),
        "real.measure_ms",
        "real.measure_ms_wavefront",
    ),
    measure=_measure,
)
