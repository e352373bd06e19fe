"""A live run: a station of its own, and a plan folder without world.json."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from microplan.executor.cli.main import main
from tests.executor.bench import Folder, assembly, quiet, world

pytestmark = pytest.mark.usefixtures("one_render_a_state")

EXAMPLE = Path(__file__).parents[3] / "examples" / "stations" / "simulated.toml"


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a plan, its world apart, and a station that is the cell.

    To the executor the cell is a hub like any other: its world is in the station's own
    folder, and the plan's is deleted.
    """
    folder = tmp_path_factory.mktemp("shop")
    maker = Folder(folder / "gear-on-shaft.plan")
    maker.write(assembly(maker), quiet(world()))
    shutil.copytree(maker.folder, folder / "whole.plan")
    (folder / "cell").mkdir()
    (maker.folder / "world.json").rename(folder / "cell" / "world.json")
    text = EXAMPLE.read_text(encoding="utf-8")
    assert text.count("{plan}/world.json") == 1
    text = text.replace("{plan}/world.json", "{station}/cell/world.json")
    (folder / "station.toml").write_text(text, encoding="utf-8")
    return folder


def run(shop: Path, plan: str, station: str, folder: Path) -> int:
    call = [str(shop / plan), "--station", station, "--no-frames"]
    return main([*call, "--run-dir", str(folder)])


def summary(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text("utf-8"))
    return found


def test_a_live_run_works_with_the_world_deleted(shop: Path, tmp_path: Path) -> None:
    assert not list((shop / "gear-on-shaft.plan").rglob("world.json"))
    station = str(shop / "station.toml")
    assert run(shop, "gear-on-shaft.plan", station, tmp_path / "live") == 0
    live = summary(tmp_path / "live")
    assert live["done"]
    assert [s["id"] for s in live["steps"]][-1] == "check_seated"
    assert live["cell_verdict"]["success"]
    # and it is the run that the plan with its world makes: nothing of it was needed
    assert run(shop, "whole.plan", station, tmp_path / "whole") == 0
    lines = [(tmp_path / n / "events.jsonl").read_bytes() for n in ("live", "whole")]
    assert lines[0] == lines[1]


def test_the_simulated_cell_says_that_it_needs_the_world(
    shop: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(shop, "gear-on-shaft.plan", "sim", tmp_path / "run") == 2
    assert "error[MP803]" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
