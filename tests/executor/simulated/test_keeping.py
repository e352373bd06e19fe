"""The simulated world in its file: the same one comes back."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.executor.simulated.keeping import keep, state_of, take
from tests.executor.bench import world

SEED = 4


def cell(path: Path) -> Cell:
    """Return a cell that keeps its world and has done something of everything."""
    made = build_cell(world(), SEED)
    keep(made, path)
    made.lens.set_magnification(20.0)
    made.light.set_level(0.5)
    made.stage.move(x_um=100.0, theta_rad=0.1)
    made.robot.move(y_um=500.0, z_um=300.0)
    made.jaws.move(96.0)
    made.camera.grab(None)
    return made


def again(path: Path) -> Cell:
    """Return a new cell with the world of a file."""
    made = build_cell(world(), SEED)
    take(made, path)
    return made


def test_the_same_world_comes_back(tmp_path: Path) -> None:
    made = cell(tmp_path / "cell.json")
    assert state_of(again(tmp_path / "cell.json")) == state_of(made)


def test_what_comes_later_is_the_same(tmp_path: Path) -> None:
    first = cell(tmp_path / "cell.json")
    second = again(tmp_path / "cell.json")
    for each in (first, second):
        each.stage.move(z_um=-50.0)
        each.lens.set_focus_um(30.0)
        each.jaws.move(130.0)
    assert state_of(second) == state_of(first)
    frames = [each.camera.grab(None).counts for each in (first, second)]
    assert (frames[0] == frames[1]).all()


@pytest.mark.parametrize("order", ["stage", "jaws", "zoom", "focus"])
def test_what_was_under_way_has_ended_by_itself(order: str, tmp_path: Path) -> None:
    made = cell(tmp_path / "cell.json")
    if order == "stage":
        made.stage.start(x_um=-300.0, z_um=20.0)
    elif order == "jaws":
        made.jaws.start(150.0)
    elif order == "zoom":
        made.lens.start_magnification(10.0)
    else:
        made.lens.start_focus_um(-40.0)
    made.timeline.advance(0.05)  # and here the executor is killed
    found = again(tmp_path / "cell.json")
    for process in (made.stage, made.jaws.motion, made.lens.motion):
        made.timeline.run_out(process)
    assert state_of(found) == state_of(made)


def test_a_motion_that_was_stopped_stays_stopped(tmp_path: Path) -> None:
    made = cell(tmp_path / "cell.json")
    made.stage.start(x_um=-300.0)
    made.timeline.advance(0.05)
    made.stage.stop()
    found = again(tmp_path / "cell.json")
    assert found.stage.reading() == made.stage.reading()
    assert -300.0 < found.stage.reading().x_um < 100.0


def test_a_file_of_another_world_is_refused(tmp_path: Path) -> None:
    cell(tmp_path / "cell.json")
    other = build_cell(replace(world(), stage_reflectance=0.5), SEED)
    with pytest.raises(ExecutorError) as caught:
        take(other, tmp_path / "cell.json")
    assert caught.value.code == "MP866"


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": 2}', '{"format": 1}'])
def test_a_damaged_file_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "cell.json").write_text(text, encoding="utf-8")
    with pytest.raises(ExecutorError) as caught:
        again(tmp_path / "cell.json")
    assert caught.value.code == "MP803"


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("opening_um", "wide"),
        ("opening_um", float("nan")),
        ("held", "wheel"),
        ("held", {}),
        ("collided", None),
        ("bodies/gear/carrier", "table"),
        ("bodies/gear/z_um", 10**400),
        ("bodies/gear/pose", []),
        ("devices/stage/motion", 7),
        ("devices/jaws/left_s", 1e300),
        ("devices/lens/left_s", float("nan")),
        ("time_s", 1e300),
        ("draws/light/uinteger", float("inf")),
        ("draws/lateral/state/state", -1),
    ],
)
def test_a_spoilt_world_is_refused(key: str, value: object, tmp_path: Path) -> None:
    path = tmp_path / "cell.json"
    cell(path)
    data = json.loads(path.read_text("utf-8"))
    *above, last = key.split("/")
    place = data
    for name in above:
        place = place[name]
    assert last in place
    place[last] = value
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(ExecutorError) as caught:
        again(path)
    assert caught.value.code == "MP803"


@pytest.mark.parametrize(
    ("key", "value"),
    [("count", 10**12), ("taken", -(10**12)), ("seconds", 1e300), ("began_s", 1e9)],
)
def test_a_motion_that_would_not_end_is_refused(
    key: str, value: float, tmp_path: Path
) -> None:
    path = tmp_path / "cell.json"
    made = cell(path)
    made.stage.start(x_um=-300.0)
    data = json.loads(path.read_text("utf-8"))
    assert key in data["devices"]["stage"]["motion"]
    again(path)
    data["devices"]["stage"]["motion"][key] = value
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(ExecutorError) as caught:
        again(path)
    assert caught.value.code == "MP803"


def test_a_file_is_whole_or_the_one_before(tmp_path: Path) -> None:
    made = cell(tmp_path / "cell.json")
    assert json.loads((tmp_path / "cell.json").read_text("utf-8")) == json.loads(
        json.dumps(state_of(made))
    )
    assert [p.name for p in tmp_path.iterdir()] == ["cell.json"]
