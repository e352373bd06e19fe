"""The report of a run: one page from the run folder, whatever is left of it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from microplan.executor.analysis.run_frames import small
from microplan.executor.analysis.run_report import run_report, write_report
from microplan.executor.analysis.run_summaries import read_left, real
from microplan.executor.cli.main import main
from microplan.executor.record.plan_file import world_beside
from microplan.schemas.files.times import spans
from microplan.schemas.plan import VerifyAction, parse_plan
from tests.executor.kept import PLAN, SAID
from tests.pages import Page, check_page

EVIL = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def page(example_run: Path) -> Page:
    """Return the run's report."""
    return check_page(run_report(read_left(example_run)))


@pytest.fixture
def copy(example_run: Path, tmp_path: Path) -> Path:
    """Return a run folder that may be changed."""
    return Path(shutil.copytree(example_run, tmp_path / "run"))


def test_a_run_writes_its_report(example_run: Path) -> None:
    file = example_run / "report.html"
    assert f"report: {file}" in example_run.with_name(SAID).read_text("utf-8")
    check_page(file.read_text(encoding="utf-8"))


def test_it_is_written_anew_with_the_same_bytes(example_run: Path, copy: Path) -> None:
    (copy / "report.html").unlink()
    plan = example_run.with_name(PLAN)
    assert main([str(plan), "--mode", "report", "--from", str(copy)]) == 0
    again = (copy / "report.html").read_bytes()
    assert again == (example_run / "report.html").read_bytes()


def test_predicted_stands_beside_actual(example_run: Path, page: Page) -> None:
    text = " ".join(page.text)
    data = json.loads((example_run / "summary.json").read_text(encoding="utf-8"))
    assert "Done" in text
    assert "seated" in text
    for step in data["steps"]:
        assert step["id"] in text
    assert f"{data['time_s']:.3g}" in text
    expected = {s["id"]: s["expected_s"] for s in data["steps"]}
    # 260 um down at 20 um/s, and the stage settles; what jaws take is stated nowhere
    assert expected["insert"] == pytest.approx(260 / 20 + 0.15)
    assert expected["grasp"] is None
    assert "not predicted (jaws)" in text
    # the first look at a zoom probes the axes, nobody knows how far
    assert expected["find_gear"] is None
    assert "not predicted (probing moves)" in text
    known = [s for s in data["steps"] if s["expected_s"] is not None]
    took, planned = (sum(s[k] for s in known) for k in ("time_s", "expected_s"))
    assert f"{took:.3g}\u202fs of it predicted as {planned:.3g}\u202fs" in text
    assert "error / limit, \u00b5m" in text
    (checked,) = (s for s in data["steps"] if s["verb"] == "verify")
    assert f"{checked['error_um']:.3g} / {checked['limit_um']:.3g}" in text
    servoed = {row["step"] for row in read_left(example_run).of("error")}
    assert servoed
    for step in servoed:
        assert f"Servo of {step}" in text
    assert "Focus sweep of check_seated" in text
    frames = [img["alt"] for img in page.of("img")]
    assert "Frame of find_gear, first frame" in frames


def test_a_sweep_takes_what_is_predicted(example_run: Path) -> None:
    folder, left = example_run.with_name(PLAN), read_left(example_run)
    plan = parse_plan((folder / "plan.json").read_text(encoding="utf-8"))
    (step,) = (s for s in plan.steps if isinstance(s.action, VerifyAction))
    assert isinstance(step.action, VerifyAction)
    assert step.action.height is not None
    stops = step.action.height.focus_um
    (ends,) = left.of("focus_curve", step.id)
    begins = next(row["t_s"] for row in left.of("focus", step.id)
                  if row["focus_um"] == stops[0])  # fmt: skip
    bare = replace(step, looks=tuple(replace(k, verdict=None) for k in step.looks))
    world = world_beside(folder)
    (span,) = spans(replace(plan, steps=(bare,)), world)  # of looks no time is known
    late = ends["t_s"] - begins - span.total_s
    # a move is seen to have ended up to .02 s later, when it is asked for next
    assert 0 <= late <= len(stops) * 0.02 + 1e-6


def test_a_failed_run_tells_where(copy: Path) -> None:
    file = copy / "summary.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    data |= {"code": "MP830", "step": "over_shaft", "message": EVIL, "plan": EVIL}
    data |= {"faults": [EVIL, "stick@release"], "idle_faults": ["stick@release"]}
    file.write_text(json.dumps(data), encoding="utf-8")
    markup = run_report(read_left(copy))
    text = " ".join(check_page(markup).text)
    assert "Failed" in text
    assert "MP830" in text
    assert f"injected faults {EVIL}, stick@release (met by nothing)" in text
    assert EVIL not in markup


def test_what_is_left_of_a_killed_run_has_a_report(copy: Path) -> None:
    (copy / "summary.json").unlink()
    events = copy / "events.jsonl"
    events.write_bytes(events.read_bytes()[: -len(b'ed"}\n') - 40])
    shutil.rmtree(copy / "frames")
    text = " ".join(check_page(run_report(read_left(copy))).text)
    assert "Not ended" in text
    assert "No frames were kept" in text


@pytest.mark.parametrize(
    "summary",
    ["[]", "{", '{"steps": 3}', '{"steps": [1, {"id": 2, "time_s": "x"}]}',
     '{"steps": [{"id": "a", "error_um": 1e999, "limit_um": 1}], "code": 7}',
     '{"steps": [{"id": "a", "error_um": 1, "limit_um": 1e-320, "spread_um": 1, '
     '"expected_sigma_um": 1e-320, "expected_s": 1' + "0" * 400 + "}]}"],
)  # fmt: skip
def test_damaged_summaries_give_a_report_all_the_same(copy: Path, summary: str) -> None:
    (copy / "summary.json").write_text(summary, encoding="utf-8")
    assert check_page(run_report(read_left(copy))).of("h1")


def test_frames_outside_the_folder_are_not_shown(copy: Path) -> None:
    shutil.copy(copy / "frames" / "01_find_gear_001.png", copy.parent / "secret.png")
    line = {"file": "../secret.png", "step": "x", "shows": None}
    (copy / "frames" / "index.jsonl").write_text(json.dumps(line), encoding="utf-8")
    assert check_page(run_report(read_left(copy))).of("img") == []


def test_a_folder_without_a_run_is_refused(
    example_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = str(example_run.with_name(PLAN))
    assert main([plan, "--mode", "report", "--from", str(tmp_path)]) == 2
    assert "error[MP879]" in capsys.readouterr().err
    assert main([plan, "--mode", "report"]) == 2


def test_a_new_run_goes_over_an_old_ones_report(copy: Path, example_run: Path) -> None:
    call = [str(example_run.with_name(PLAN)), "--station", "sim", "--mode", "check"]
    assert main([*call, "--run-dir", str(copy)]) == 0
    write_report(copy)
    names = {path.name for path in copy.iterdir()}
    assert "report.html.new" not in names


def test_a_frame_of_one_row_is_made_small() -> None:
    assert small(np.full((1, 1000), 7, np.uint8)).shape == (1, 250)
    assert small(np.full((1000, 1), 7, np.uint8)).shape == (250, 1)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_frames_are_made_small_by_averages(dtype: type[np.unsignedinteger]) -> None:
    frame: np.ndarray = np.full((960, 1280), 40, dtype=dtype)
    frame[:, 640:] = 80
    found = small(frame)
    assert found.shape == (240, 320)
    assert found.dtype == np.uint8
    scale = 1.0 if dtype is np.uint8 else 255 / 80
    assert np.unique(found).tolist() == [round(40 * scale), round(80 * scale)]


@pytest.mark.parametrize(
    "value", [None, True, "1", float("nan"), float("inf"), [1], 10**400]
)
def test_only_finite_numbers_are_numbers(value: object) -> None:
    assert real({"x": value}, "x") is None


def test_starting_the_executor_loads_no_page() -> None:
    script = (
        "import sys, microplan.executor.cli.main\n"
        "sys.exit(' '.join(m for m in sys.modules if 'html' in m or 'run_report' in m))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.stderr.strip() == ""


def test_numbers_that_no_device_gives_break_no_chart(copy: Path) -> None:
    file = copy / "summary.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    for step, size in zip(
        data["steps"], [1e308, 10**400, 5e-324, -1e308], strict=False
    ):
        step |= {"error_um": 1.0, "limit_um": size, "spread_um": size}
        step["expected_sigma_um"] = 5e-324
    file.write_text(json.dumps(data), encoding="utf-8")
    assert check_page(run_report(read_left(copy))).of("svg")
