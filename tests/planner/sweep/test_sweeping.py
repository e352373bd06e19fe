"""Sweeps: the rows are those of compiles, whoever makes them; finished ones stay."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from microplan.planner.cli.main import main
from microplan.planner.source.changed_values import ChangedValue
from microplan.planner.source.diagnostics import Report
from microplan.planner.source.source import Source, parse
from microplan.planner.store.store import Store
from microplan.planner.sweep.sweeping import ROWS, SweepCall, write_sweep
from microplan.planner.task.read_task import load_task
from tests.planner.examples import change
from tests.planner.sweep.no_looks import SETTINGS, no_looks, readings, swept

CACHE = ("--cache", str(readings()))


def test_rows_do_not_depend_on_jobs(tmp_path: Path) -> None:
    task = no_looks(tmp_path / "task")
    alone = swept(task, tmp_path / "1", jobs=1)
    assert [row["row"] for row in alone] == list("123456")
    humidities = [row["environment.humidity"] for row in alone]
    assert humidities == ["0.1", "0.1", "0.5", "0.5", "0.9", "0.9"]
    assert len({row["plan_sha256"] for row in alone}) == 6
    assert swept(task, tmp_path / "3", jobs=3) == alone


def test_a_row_is_the_plan_of_the_edited_task(tmp_path: Path) -> None:
    task = no_looks(tmp_path / "task")
    (row,) = [
        row
        for row in swept(task, tmp_path / "out")
        if (row["environment.humidity"], row["seed"]) == ("0.9", "2")
    ]
    change(task, "humidity: 0.4", "humidity: 0.9")
    change(task, "seed: 1998", "seed: 2")
    plan = tmp_path / "a.plan"
    assert main(["compile", str(task), "-o", str(plan), *CACHE]) in (0, 1)
    data = (plan / "plan.json").read_bytes()
    assert row["plan_sha256"] == hashlib.sha256(data).hexdigest()
    found = json.loads(data)
    assert row["status"] == found["status"]
    if row["success_probability"]:
        known = pytest.approx(found["success_probability"], abs=1e-6)  # as written
        assert float(row["success_probability"]) == known


def test_finished_rows_are_not_made_again(tmp_path: Path) -> None:
    task, out = no_looks(tmp_path / "task"), tmp_path / "out"
    first = swept(task, out)
    lines = (out / ROWS).read_bytes().splitlines(keepends=True)
    # stopped in the middle of the fifth row; what no row is stays out of it
    (out / ROWS).write_bytes(b"no row\n" + b"".join(lines[:4]) + lines[4][:50])
    assert swept(task, out) == first
    after = (out / ROWS).read_bytes().splitlines(keepends=True)
    assert after[:5] == [b"no row\n", *lines[:4]]
    assert len(after) == 1 + 4 + 1 + 2
    assert swept(task, out) == first
    assert (out / ROWS).read_bytes() == b"".join(after)


def test_other_inputs_are_made_anew(tmp_path: Path) -> None:
    task, out = no_looks(tmp_path / "task"), tmp_path / "out"
    first = swept(task, out)
    change(task, "roughness_nm: 20", "roughness_nm: 200")
    other = swept(task, out)
    shas = [{row["plan_sha256"] for row in rows} for rows in (first, other)]
    assert not shas[0] & shas[1]
    assert len((out / ROWS).read_bytes().splitlines()) == 12


@pytest.mark.parametrize(
    ("setting", "code", "said"),
    [
        ("seed=1,2,x", "MP101", "row 3, seed=x: seed must be a whole number"),
        ("sed=1", "MP104", "row 1, sed=1: unknown key 'sed'"),
        ("steps.grab.opening_um=90", "MP104", "no entry 'grab'; allowed: grasp, rel"),
        ("workcell.camera.bits=8,99", "MP103", "row 2, workcell.camera.bits=99"),
        ("workcell=none.yaml", "MP001", "row 1, workcell=none.yaml: cannot read"),
        ("seed=[", "MP730", "not valid YAML"),
        ("environment={humidity: .2}", "MP730", "set the same value, or one a part"),
    ],
)
def test_values_that_cannot_be_are_found_before_a_row_is_made(
    setting: str,
    code: str,
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    task, out = no_looks(tmp_path / "task"), tmp_path / "out"
    words = ["--format", "json", "-o", str(out), "--set", "environment.humidity=.1"]
    assert main(["sweep", str(task), *words, "--set", setting]) == 2
    found = json.loads(capsys.readouterr().out)["findings"]
    assert [each["code"] for each in found if each["severity"] == "error"] == [code]
    assert said in found[0]["message"]
    assert not out.exists()


@pytest.mark.parametrize(
    ("keys", "apart"),
    [
        (("steps.0.opening_um", "steps.grasp.opening_um"), False),
        (("steps.grasp.opening_um", "steps.grasp"), False),
        (("workcell.camera", "workcell.camera.bits"), False),
        (("steps.0.opening_um", "steps.release.opening_um"), True),
        (("environment.humidity", "environment.roughness_nm"), True),
    ],
)
def test_no_value_is_set_under_two_names(
    keys: tuple[str, str], apart: bool, tmp_path: Path
) -> None:
    task, report = no_looks(tmp_path / "task"), Report()
    found = [
        ChangedValue(key=tuple(key.split(".")), value=100 - n)
        for n, key in enumerate(keys)
    ]
    load_task(task, report, found)
    assert apart == ("MP730" not in {each.code for each in report.found})


def test_a_value_that_cannot_be_is_told_by_its_first_row(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task = no_looks(tmp_path / "task")
    words = ["--set", "environment.humidity=.1,x", "--set", "seed=1,2,y"]
    assert main(["sweep", str(task), *words]) == 2
    said = capsys.readouterr().err
    assert "row 4, environment.humidity=x:" in said  # .1: 1 to 3
    assert "row 3, seed=y:" in said


def test_a_file_is_parsed_once_for_all_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    task, parsed = no_looks(tmp_path / "task"), list[str]()

    def counted(text: str, path: Path, file: str, report: Report) -> Source | None:
        parsed.append(path.name)
        return parse(text, path, file, report)

    monkeypatch.setattr("microplan.planner.source.source.parse", counted)
    swept(task, tmp_path / "out")
    assert sorted(parsed) == ["task.yaml", "workcell.yaml"]


def test_a_combination_that_cannot_be_is_a_row(tmp_path: Path) -> None:
    """Each value alone is good; together the interval runs backwards."""
    task, out = no_looks(tmp_path / "task"), tmp_path / "out"
    asked = (
        ("workcell.optics.magnification.min", "6.9,30"),
        ("workcell.optics.magnification.max", "20,40"),
    )
    report = Report()
    call = SweepCall(settings=asked, out=out, store=Store(readings()))
    said = write_sweep(str(task), call, report)
    assert not report.failed
    assert "1 error" in said
    rows = [json.loads(line) for line in (out / ROWS).read_text().splitlines()]
    (bad,) = [row for row in rows if row["status"] == "error"]
    assert list(bad["set"].values()) == [30, 20]
    assert bad["reason"].startswith("MP113")


@pytest.mark.parametrize("setting", ["seed", "=1", "a..b=1", "seed="])
def test_a_setting_without_key_or_values_is_a_wrong_call(
    setting: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", "task.yaml", "--set", setting]) == 2
    assert "allowed: KEY=VALUE" in capsys.readouterr().err


def test_a_scheduler_that_does_not_answer_is_a_finding(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without Dask too: then it says what to install."""
    task = no_looks(tmp_path / "task")
    words = ["--scheduler", "tcp://nowhere"]  # no port
    assert main(["sweep", str(task), "--set", "seed=1", *words]) == 2
    assert main(["compile", str(task), "-o", str(tmp_path / "p"), *words]) == 2
    said = capsys.readouterr().err
    assert said.count("error[MP731]") == 2
    assert "bug" not in said


def test_the_table_is_printed_as_rows_come(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task = no_looks(tmp_path / "task")
    words = [word for key, values in SETTINGS for word in ("--set", f"{key}={values}")]
    out = ["-o", str(tmp_path / "out"), *CACHE]
    assert main(["sweep", str(task), *words, *out]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:3] == ["row", "environment.humidity", "seed"]
    assert [line.split()[:3] for line in lines[1:7]] == [
        [str(2 * k + n), humidity, str(n)]
        for k, humidity in enumerate(("0.1", "0.5", "0.9"))
        for n in (1, 2)
    ]
    assert lines[7].startswith("6 rows: ")
