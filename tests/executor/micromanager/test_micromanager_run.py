"""A whole plan on Micro-Manager's demo devices, the picture rendered."""

from __future__ import annotations

import importlib.util
import json
import math
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.executor.cli.main import main
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.station_file import read_station
from microplan.executor.simulated.cell import build_cell
from microplan.executor.simulated.following import DeviceReadings, follow
from microplan.schemas.codec import to_data
from microplan.schemas.plan import InsertAction, Plan
from microplan.schemas.pose import Pose
from tests.executor.bench import (
    MAGNIFICATION,
    Folder,
    assembly,
    microscope_at,
    quiet,
    world,
)

HERE = importlib.util.find_spec("pymmcore_plus") is not None
if HERE:
    from mm_test_adapters import device_adapter_path
    from pymmcore_plus.experimental.unicore import UniMMCore

    from tests.executor.micromanager.micromanager_bench import EXAMPLE
needs_it = pytest.mark.skipif(not HERE, reason="needs microplan[micromanager]")
HASTE = 20.0  # the demo devices go by the machine's own time


def hasty(plan: Plan) -> Plan:
    """Return a plan whose insertion takes a fraction of its time."""
    steps = []
    for step in plan.steps:
        action = step.action
        if isinstance(action, InsertAction):
            moves = tuple(
                replace(m, speed_um_per_s=(m.speed_um_per_s or 0.0) * HASTE)
                for m in action.moves
            )
            step = replace(step, action=replace(action, moves=moves))
        steps.append(step)
    return replace(plan, steps=tuple(steps))


def hasty_station(folder: Path) -> Path:
    """Return the example's station with everything faster."""
    speeds = r"\b(speed|\w+_per_s) = (\d+\.\d)\b"
    text = re.sub(
        speeds,
        lambda m: f"{m[1]} = {float(m[2]) * HASTE}",
        EXAMPLE.read_text(encoding="utf-8"),
    ).replace("dwell_s = 0.15", "dwell_s = 0.03")
    path = folder / "station.toml"
    path.write_text(text, encoding="utf-8")
    return path


@needs_it
def test_a_plan_runs_from_its_first_grab_to_its_verification(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    maker = Folder(tmp_path / "gear.plan")
    plan = hasty(assembly(maker))
    path = maker.write(plan, quiet(world()))
    station = hasty_station(tmp_path)
    run_folder = tmp_path / "run"
    done = main(
        [
            str(path),
            "--station",
            str(station),
            "--run-dir",
            str(run_folder),
            "--no-frames",
        ]
    )
    told = capsys.readouterr()
    assert done == 0, told
    assert "the cell's own verdict: seated" in told.out
    lines = (run_folder / "events.jsonl").read_text(encoding="utf-8").splitlines()
    events = [json.loads(line) for line in lines]
    names = [event["event"] for event in events]
    assert names.index("zoom") < names.index("move") < names.index("jaws")
    assert [e["step"] for e in events if e["event"] == "done"] == [
        step.id for step in plan.steps
    ]


@needs_it
def test_a_run_that_is_told_to_end_stops_and_does_not_abort(tmp_path: Path) -> None:
    maker = Folder(tmp_path / "gear.plan")
    path, log = maker.write(assembly(maker), quiet(world())), tmp_path / "events"
    call = [str(path), "--station", str(EXAMPLE), "--run-dir", str(log), "--no-frames"]
    program = (
        "import sys\nfrom microplan.executor.cli.main import main\n"
        f"sys.exit(main({call!r}))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=EXAMPLE.parents[2],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as run:
        until_s = time.monotonic() + 60.0
        while '"move"' not in _told(log / "events.jsonl"):  # a robot on its way
            assert time.monotonic() < until_s
            time.sleep(0.02)
        run.send_signal(signal.SIGTERM)
        _, wrong = run.communicate(timeout=60.0)
    assert run.returncode == 4, wrong
    assert wrong.startswith("error[MP860]: stopped; nothing moves any more")
    assert "FATAL" not in wrong
    assert '"moved"' not in _told(log / "events.jsonl").splitlines()[-1]


def _told(log: Path) -> str:
    """Return what a journal holds by now."""
    return log.read_text(encoding="utf-8") if log.is_file() else ""


@needs_it
def test_a_rendered_hub_moves_only_demo_devices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from microplan.executor.micromanager import demo

    (tmp_path / "world.json").write_text(json.dumps(to_data(world())), encoding="utf-8")
    monkeypatch.setattr(demo, "DEMO", ("SequenceTester",))
    with pytest.raises(ExecutorError, match="XY is of DemoCamera") as told:
        read_station(EXAMPLE, tmp_path)
    assert told.value.code == "MP813"


@needs_it
def test_the_light_is_in_the_picture(tmp_path: Path) -> None:
    (tmp_path / "world.json").write_text(
        json.dumps(to_data(quiet(world()))), encoding="utf-8"
    )
    loaded = read_station(hasty_station(tmp_path), tmp_path)
    station = loaded.station
    means = []
    for level in (1.0, 0.5, 0.0):
        station.light.set_level(level)
        now_s = station.clock.now_s()
        means.append(station.camera.grab(None, after_s=now_s).counts.mean())
    loaded.hubs["mm"].close()
    assert means[1] == pytest.approx(means[0] / 2, rel=0.02)
    assert means[2] < 0.5  # of 255: what reading noise leaves above 0


@needs_it
def test_the_picture_follows_stage_and_focus(tmp_path: Path) -> None:
    """As a user of pymmcore-plus has it: a core, demo stages, and the camera."""
    from microplan.executor.micromanager.core import close_core
    from microplan.executor.micromanager.rendered_camera import Labels, RenderedCamera

    folder = tmp_path / "gear.plan"
    folder.mkdir()
    start = replace(world().stage.start, x_um=0.0)
    still = quiet(world())
    gear, plate = still.parts
    still = replace(
        still,
        stage=replace(still.stage, start=start),
        parts=(replace(gear, start=Pose(x_um=0.0, y_um=0.0)), plate),
    )
    (folder / "world.json").write_text(json.dumps(to_data(still)), encoding="utf-8")
    labels = Labels(xy="XY", z="Z", focus="Focus")
    core = demo_core()
    try:
        core.loadPyDevice("Camera", RenderedCamera.of_plan(folder, core, labels))
        core.initializeDevice("Camera")
        core.setCameraDevice("Camera")
        core.setPosition("Focus", 100.0)
        first = snap(core)
        core.setXYPosition("XY", 60.0, -30.0)
        core.waitForDevice("XY")
        moved = snap(core)
        core.setPosition("Focus", 0.0)
        blurred = snap(core)
        core.setPosition("Z", -100.0)
        sharp = snap(core)
        live = watched(core)
        core.setROI(200, 100, 240, 280)
        part = snap(core)
    finally:
        close_core(core)
    per_um = microscope_at(MAGNIFICATION).px_per_um
    column, row = centre(moved) - centre(first)
    # the background's share in the centre of brightness is even: 1 px is generous
    assert column == pytest.approx(60.0 * per_um, abs=1.0)
    assert row == pytest.approx(30.0 * per_um, abs=1.0)
    assert edge(blurred) < 0.5 * edge(moved)
    optics = still.optics
    most_e2 = optics.full_well_e + optics.read_noise_e**2  # variance at full scale
    sigma = 255 * math.sqrt(2 * most_e2) / optics.full_well_e  # of a difference
    # 6 sigma in 67200 pixels: once in 8000 seeds; both are rounded by up to a half
    assert np.abs(part - sharp[100:380, 200:440]).max() <= 6 * sigma + 1
    assert edge(sharp) == pytest.approx(edge(moved), rel=0.05)
    assert centre(live) == pytest.approx(centre(sharp), abs=0.5)  # noise apart


def demo_core() -> UniMMCore:
    """Return a core with three demo stages."""
    core = UniMMCore()
    core.setDeviceAdapterSearchPaths([device_adapter_path()])
    for label, device in (("XY", "DXYStage"), ("Z", "DStage"), ("Focus", "DStage")):
        core.loadDevice(label, "DemoCamera", device)
        core.initializeDevice(label)
    return core


def snap(core: UniMMCore) -> FloatArray:
    """Return a picture as numbers."""
    core.snapImage()
    return np.array(core.getImage(), dtype=float)


def watched(core: UniMMCore) -> FloatArray:
    """Return the second picture of a live view."""
    until_s = time.monotonic() + 30.0
    core.startContinuousSequenceAcquisition()
    while core.getRemainingImageCount() < 2:
        assert time.monotonic() < until_s
        time.sleep(0.02)
    core.stopSequenceAcquisition()
    core.popNextImage()
    return np.array(core.popNextImage(), dtype=float)


def centre(image: FloatArray) -> FloatArray:
    """Return (column, row) of the centre of the gear, which is bright."""
    row, column = np.nonzero(image > 120)
    return np.array([column.mean(), row.mean()])


def edge(image: FloatArray) -> float:
    """Return how steep the steepest edges are."""
    return float(np.quantile(np.abs(np.diff(image, axis=1)), 0.9999))


def test_a_cell_is_led_past_what_touches_and_told_once_of_jaws_and_lens() -> None:
    cell = build_cell(quiet(world()), 0)
    start = cell.stage.reading()
    follow(cell, DeviceReadings(stage=replace(start, x_um=start.x_um + 100.0)), 1.0)
    assert cell.truth.stage_pose().x_um == start.x_um + 100.0
    assert cell.truth.time_s == 1.0
    follow(cell, DeviceReadings(opening_um=120.0 + 1e-9, magnification=10.0), 2.0)
    jumps, now_s = cell.lens.shift_um, cell.truth.time_s
    follow(cell, DeviceReadings(opening_um=120.0, magnification=10.0), 2.0)
    assert (cell.jaws.reading(), cell.lens.shift_um) == (120.0, jumps)
    assert cell.truth.time_s == now_s  # nothing was moved again
    low = replace(cell.robot.reading(), y_um=0.0, z_um=-50.0)
    follow(cell, DeviceReadings(robot=low), 3.0)
    assert cell.truth.collided
