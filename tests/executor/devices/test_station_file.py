"""station.toml: the simulated cell through it, and every mistake told with its key."""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from microplan.executor.cli.main import main
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import Rules, Safety
from microplan.executor.devices.station_file import Loaded, read_station
from microplan.executor.devices.timeouts import WallClock
from microplan.executor.simulated.cell import Cell, build_cell, offer_of, rules_of
from microplan.executor.simulated.timeline import HANG_S, RENDER_S
from microplan.schemas.codec import to_data
from tests.executor.bench import QUICK, Folder, assembly, quiet, world

EXAMPLE = Path(__file__).parents[3] / "examples" / "stations" / "simulated.toml"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the small plan's folder, in a world without spreads."""
    maker = Folder(tmp_path_factory.mktemp("plans") / "gear-on-shaft.plan")
    maker.write(assembly(maker), quiet(world()))
    return maker.folder


def loaded(plan: Path, folder: Path, *changes: tuple[str, str]) -> Loaded:
    """Read the example with changes."""
    text = EXAMPLE.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "station.toml"
    path.write_text(text, encoding="utf-8")
    return read_station(path, plan)


def events(folder: Path) -> list[dict[str, Any]]:
    text = (folder / "events.jsonl").read_text(encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()]


def places(log: list[dict[str, Any]]) -> list[float]:
    """Return where the looks found their targets, um."""
    seen = (e["at"] for e in log if e["event"] == "seen")
    return [value for at in seen for value in (at["x_um"], at["y_um"])]


def test_the_example_says_what_the_simulated_cell_is(
    built: Path, tmp_path: Path
) -> None:
    found = loaded(built, tmp_path)
    offer, meant = to_data(found.station.offer), to_data(offer_of(world()))
    calibration = offer.pop("calibration")
    meant.pop("calibration")
    for name, value in meant.pop("travel").items():
        assert offer["travel"].pop(name) == pytest.approx(value, rel=1e-5)
    assert not offer.pop("travel")
    assert offer == meant
    for zoom in calibration["zooms"]:
        assert zoom["um_per_px"] == pytest.approx(7.5 / zoom["magnification"], rel=1e-5)
    rules, simulated = found.station.rules, rules_of(world())
    assert rules.stage.dwell_s == simulated.stage.dwell_s
    assert rules.stage_speeds == simulated.stage_speeds
    assert rules.robot_speeds == simulated.robot_speeds
    assert rules.stage_datum_z_um == simulated.stage_datum_z_um
    assert rules.stage.window_um == Rules().stage.window_um
    assert rules.safety.grab_s == simulated.safety.grab_s


def test_a_simulated_camera_that_hangs_is_given_up_as_soon_as_any_other() -> None:
    hangs = build_cell(world(), 0, ("camera_hangs@lift",), camera="quick")
    renders = build_cell(world(), 0, camera="quick")
    found = [cell.station.rules.safety.grab_s for cell in (hangs, renders)]
    assert found == [Safety().grab_s, RENDER_S]
    assert HANG_S > RENDER_S


def test_a_plan_runs_the_same_through_a_file(built: Path, tmp_path: Path) -> None:
    call = [str(built), "--no-frames", "--run-dir"]
    same = [*QUICK]  # as the file's, unless it says so
    assert main([*call, str(tmp_path / "sim"), *same]) == 0
    assert main([*call, str(tmp_path / "file"), "--station", str(EXAMPLE)]) == 0
    sim, file = events(tmp_path / "sim"), events(tmp_path / "file")
    assert [e["event"] for e in sim] == [e["event"] for e in file]
    assert [e["t_s"] for e in sim] == [e["t_s"] for e in file]
    # six digits of the scale flip grey levels, and from the probe on what is seen
    # steers: two looks of 4 nm noise each at four sigma
    assert places(sim) == pytest.approx(places(file), abs=4 * math.hypot(4e-3, 4e-3))
    summary = json.loads((tmp_path / "file" / "summary.json").read_text())
    assert summary["station"] == "simulated sandia-1998"
    assert summary["cell_verdict"]["success"]


def test_a_station_without_robot_jaws_and_clock_is_read(
    built: Path, tmp_path: Path
) -> None:
    found = loaded(
        built,
        tmp_path,
        ('robot = { hub = "cell" }\n', ""),
        ('jaws = { hub = "cell" }\n', ""),
        ('clock = { hub = "cell" }', ""),
    ).station
    assert found.robot is None
    assert found.gripper is None
    assert found.offer.opening_um is None
    assert "robot.x_um" not in found.offer.travel
    assert isinstance(found.clock, WallClock)


def test_options_reach_the_driver(built: Path, tmp_path: Path) -> None:
    found = loaded(
        built, tmp_path, ("seed = 0", 'seed = 4\nfaults = ["stick"]\nquantum_um = 0.05')
    )
    cell = found.hubs["cell"]
    assert isinstance(cell, Cell)
    assert cell.faults.on("stick")
    cell.stage.move(x_um=0.07)
    assert cell.stage.reading().x_um == pytest.approx(0.05)


def test_faults_of_a_file_are_told(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, run = tmp_path / "station.toml", tmp_path / "run"
    faults = 'faults = ["no_part", "stick@release"]'
    text = EXAMPLE.read_text(encoding="utf-8").replace("seed = 0", faults)
    file.write_text(text, encoding="utf-8")
    call = [str(built), "--no-frames", "--run-dir", str(run), "--station", str(file)]
    assert main(call) == 1
    said = "injected faults: no_part, stick@release (met by nothing)"
    assert said in capsys.readouterr().out
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    assert summary["faults"] == ["no_part", "stick@release"]
    assert summary["idle_faults"] == ["stick@release"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "microplan_station = 1",
            "microplan_station = 2",
            "microplan_station: found 2",
        ),
        ('name = "simulated sandia-1998"', "", "name: it is missing; a text is needed"),
        ("[camera]\n", "[camera]\nwidht_px = 640\n", "camera.widht_px: no such key"),
        ("bits = 8", "bits = true", "camera.bits: found True; a finite number"),
        ("bits = 8", "bits = 0", "camera.bits: found 0; it must be at least 1"),
        ("bits = 8", "bits = 8.5", "camera.bits: found 8.5; a whole number"),
        ("pitch_um = 7.5", "pitch_um = nan", "camera.pitch_um: found nan"),
        ("pitch_um = 7.5", "pitch_um = 0", "found 0; it must be more than 0"),
        ("focus_um = [-500.0, 500.0]", "focus_um = [5, -5]", "the first must be less"),
        ("focus_um = [-500.0, 500.0]", "focus_um = 5", "found 5; two numbers"),
        (
            "speeds = { xy_um_per_s = 1000.0",
            "speeds = { xy_um_per_s = -1",
            "stage.speeds.xy_um_per_s: found -1",
        ),
        ("z_um_per_s = 500.0, ", "", "stage.speeds.z_um_per_s: it is missing"),
        (
            "dwell_s = 0.15",
            "dwel_s = 0.15",
            "stage.settle.dwel_s: no such key, did you mean 'dwell_s'?",
        ),
        ("datum_z_um = 0.0", "", "stage.datum_z_um: it is missing"),
        (
            "limits = { x_um",
            "limits = { tip_um = [0, 1], x_um",
            "stage.limits.tip_um: no such key",
        ),
        (
            "magnification = 44.5, um",
            "magnification = 4.5, um",
            "magnifications must rise",
        ),
        (
            "[[1.0, 0.0], [0.0, 1.0]]",
            "[[1.0, 0.0], [1.0, 0.0]]",
            "it must be invertible",
        ),
        ("[[1.0, 0.0], [0.0, 1.0]]", "[1.0, 0.0]", "camera_from_stage[0]: found 1.0"),
        ('["insert"]', '["inserting"]', "found 'inserting'; allowed: approach, servo"),
        (
            "fingers_above_stage_um = 5.0",
            "",
            "safety.fingers_above_stage_um: it is missing",
        ),
        ("retreat = {", "retreet = {", "safety.retreet: no such key"),
        (
            'stage = { hub = "cell" }',
            'stage = { hub = "sell" }',
            "devices.stage.hub: found 'sell', did you mean 'cell'?; allowed: cell",
        ),
        (
            'stage = { hub = "cell" }',
            'stage = { hub = "cell", port = 1 }',
            "devices.stage.port: no such key",
        ),
        ('light = { hub = "cell" }\n', "", "devices.light: it is missing"),
        (
            'stage = { hub = "cell" }',
            'stagr = { hub = "cell" }',
            "devices.stagr: no such device, did you mean 'stage'?; allowed: stage",
        ),
        ('stage = { hub = "cell" }', "stage = 3", "devices.stage: found 3; a table"),
        ("[devices]", "[devices", "at line"),
        ("call_s = 5.0", "call_s = 1e12", "call_s: found 1e+12; it must be at most"),
        ("poll_s = 0.02", "poll_s = 5", "poll_s: found 5; it must be at most 1"),
        ("bits = 8", f"bits = {10**400}", "a finite number is needed"),
        ("bits = 8", "bits = " + "9" * 5000, "4300 digits"),
    ],
)
def test_a_mistake_is_told_with_file_and_key(
    old: str, new: str, message: str, built: Path, tmp_path: Path
) -> None:
    with pytest.raises(ExecutorError) as caught:
        loaded(built, tmp_path, (old, new))
    assert caught.value.code == "MP812"
    assert message in caught.value.message
    assert "station.toml" in caught.value.message


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("executor.simulated.hub:cell", "nowhere_at_all:cell", "No module named"),
        ("executor.simulated.hub:cell", "executor.simulated.hub:sell", "sell"),
        (
            "executor.simulated.hub:cell",
            "executor.cli.main:__name__",
            "cannot be called",
        ),
        ("executor.simulated.hub:cell", "my_cell", "no driver 'my_cell' in microplan"),
        ("seed = 0", "sead = 0", "unexpected keyword argument 'sead'"),
        ("seed = 0", "seed = -1", "ValueError"),
        ("seed = 0", 'faults = ["fire"]', "no fault is called 'fire'"),
        (
            'stage = { hub = "cell" }',
            'stage = { hub = "cell", part = "wheel" }',
            "hub 'cell' has no 'wheel'",
        ),
        (
            'stage = { hub = "cell" }',
            'stage = { hub = "cell", part = "camera" }',
            "SimCamera is no stage, it has no reading",
        ),
        ("executor.simulated.hub:cell", ".hub:cell", "TypeError"),
    ],
)
def test_a_driver_that_cannot_be_had_is_told(
    old: str, new: str, message: str, built: Path, tmp_path: Path
) -> None:
    with pytest.raises(ExecutorError) as caught:
        loaded(built, tmp_path, (old, new))
    assert caught.value.code == "MP813"
    assert message in caught.value.message


def line_of(file: Path, words: str) -> int:
    """Return the line of a file that holds some words."""
    lines = file.read_text(encoding="utf-8").splitlines()
    return 1 + next(k for k, line in enumerate(lines) if words in line)


def test_every_mistake_of_a_file_is_told_at_its_line(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "station.toml"
    changes = {
        "width_px = 640": "widht_px = 640",
        "bits = 8": 'bits = "8"',
        'jaws = { hub = "cell" }': 'jaws = { hub = "sell" }',
        "magnification = 6.9, um": "magnificaton = 6.9, um",
        "close_phases": "close_fases",
        'light = { hub = "cell" }': "",
    }
    text = EXAMPLE.read_text(encoding="utf-8")
    for old, new in changes.items():
        text = text.replace(old, new, 1)
    file.write_text(text, encoding="utf-8")
    assert main([str(built), "--station", str(file)]) == 2
    told = capsys.readouterr().err.splitlines()
    said = {
        "camera.widht_px: no such key, did you mean 'width_px'?; allowed": "widht_px",
        "camera.bits: found '8'; a finite number is needed": "bits",
        "devices.jaws.hub: found 'sell', did you mean 'cell'?; allowed: cell": "jaws =",
        "zooms[0].magnificaton: no such key, did you mean 'magnification'": "caton",
        "safety.close_fases: no such key, did you mean 'close_phases'": "close_fases",
        "devices.light: it is missing; a table is needed": "[devices]",
    }
    assert sum(line.startswith("error[MP812]: ") for line in told) == len(said)
    for words, near in said.items():
        (at,) = (k for k, line in enumerate(told) if words in line)
        assert told[at + 1] == f"  --> {file}:{line_of(file, near)}"


def test_a_misspelt_driver_is_told_at_its_line(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "station.toml"
    text = EXAMPLE.read_text(encoding="utf-8").replace("hub:cell", "hub:cel", 1)
    file.write_text(text, encoding="utf-8")
    assert main([str(built), "--station", str(file)]) == 2
    told = capsys.readouterr().err
    assert told.startswith("error[MP813]: hubs.cell: 'executor.simulated.hub:cel': ")
    assert f"  --> {file}:{line_of(file, 'hub:cel')}\n" in told


def test_what_is_no_file_is_told_and_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "station.toml"
    os.mkfifo(pipe)
    for path in (pipe, tmp_path):
        with pytest.raises(ExecutorError, match="it is no file") as caught:
            read_station(path, tmp_path)
        assert caught.value.code == "MP812"


ODD = """
class Odd(BaseException):
    def __str__(self):
        raise ValueError("no words")

class Hub:
    def __getattr__(self, name):
        raise SystemExit(0)

def leaves(**options):
    raise SystemExit(0)

def wordless(**options):
    raise Odd
"""


@pytest.mark.parametrize(
    ("source", "attribute", "message"),
    [
        ("raise RuntimeError('no DLL')", "cell", "RuntimeError: no DLL"),
        ("def cell(:", "cell", "SyntaxError"),
        ("raise SystemExit(0)", "cell", "SystemExit: 0"),
        (ODD, "leaves", "SystemExit: 0"),
        (ODD, "wordless", "Odd, whose words raise ValueError"),
        (ODD, "Hub", "SystemExit: 0"),
    ],
)
def test_a_driver_that_fails_oddly_is_told(
    source: str,
    attribute: str,
    message: str,
    built: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A driver that exits with status 0 would else look like a run that is done."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "odd_driver", raising=False)
    (tmp_path / "odd_driver.py").write_text(source, encoding="utf-8")
    text = EXAMPLE.read_text(encoding="utf-8")
    start, end = text.index("driver = "), text.index("[devices]")
    made = f'driver = "odd_driver:{attribute}"\n'
    path = tmp_path / "station.toml"
    path.write_text(text[:start] + made + text[end:], encoding="utf-8")
    with pytest.raises(ExecutorError) as caught:
        read_station(path, built)
    assert caught.value.code == "MP813"
    assert message in caught.value.message


def test_a_missing_world_is_told_as_such(built: Path, tmp_path: Path) -> None:
    with pytest.raises(ExecutorError) as caught:
        loaded(tmp_path / "no.plan", tmp_path)
    assert caught.value.code == "MP803"


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("um_per_px = 1.0869565", "um_per_px = 1.15", "MP814"),
        (
            "magnification = 6.9, um_per_px = 1.0869565",
            "magnification = 9.0, um_per_px = 0.8333333",
            "MP814",
        ),
        ("[[1.0, 0.0], [0.0, 1.0]]", "[[0.0, 1.0], [1.0, 0.0]]", "MP814"),
        ("[[1.0, 0.0], [0.0, 1.0]]", "[[0.0, -1.0], [1.0, 0.0]]", "MP814"),
        ("[[1.0, 0.0], [0.0, 1.0]]", "[[1.03, 0.0], [0.0, 1.0]]", "MP814"),
        ("speed_um_per_s = 50.0", "speed_um_per_s = 15.0", "MP815"),
        ("theta_axis_um = [0.0, 0.0]", "theta_axis_um = [9.0, 0.0]", "MP809"),
        ("bits = 8", "bits = 12", "MP805"),
    ],
)
def test_a_station_that_does_not_fit_is_refused_before_it_moves(
    old: str,
    new: str,
    code: str,
    built: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "station.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    call = [str(built), "--station", str(tmp_path / "station.toml")]
    assert main([*call, "--run-dir", str(tmp_path / "run")]) == 3
    assert f"error[{code}]" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_seed_and_faults_belong_to_the_built_in_cell(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = shutil.copytree(built, tmp_path / "copy.plan")
    assert main([str(plan), "--station", str(EXAMPLE), "--seed", "3"]) == 2
    assert main([str(plan), "--station", "sim", "--inject", "fire"]) == 2
    err = capsys.readouterr().err
    assert err.count("error[MP804]") == 2
    assert "no fault is called 'fire'" in err
    assert main([str(plan), "--station", "sim", "--inject", "ligt_out"]) == 2
    assert "'ligt_out', did you mean 'light_out'?" in capsys.readouterr().err
