"""The plan folder is replaced whole or not at all."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from microplan.planner.cli.main import main
from microplan.planner.plan.compiler import compile_task
from microplan.planner.plan.emit import PlanFiles, plan_bytes
from microplan.planner.plan.options import Options
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.folder import OutputError, write_files, write_folder
from microplan.schemas.plan import dump_plan
from tests.planner.examples import GRASP, between_jaws, copy_example, cut, read


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> PlanFiles:
    """Return a plan without looks, and a picture."""
    task = copy_example(tmp_path_factory.mktemp("emit") / "task")
    between_jaws(task)
    cut(task, GRASP)
    found = compile_task(read(task), Report(), Options(preset="fast"))
    assert found is not None
    black = np.zeros((4, 6), dtype=np.uint8)
    # of a look called grasp: what no plan names would be somebody else's
    arrays = {"artifacts/grasp.ncc.npz": {"b": np.ones(3, np.float32)}}
    return replace(found, images={"images/grasp.png": black}, arrays=arrays)


def content(folder: Path) -> dict[str, bytes]:
    """Return every file below a folder."""
    return {
        p.relative_to(folder).as_posix(): p.read_bytes()
        for p in folder.rglob("*")
        if p.is_file()
    }


def test_a_folder_holds_what_it_should(files: PlanFiles, tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "x.plan"
    write_folder(plan_bytes(files), folder)
    assert sorted(content(folder)) == [
        "artifacts/grasp.ncc.npz", "images/grasp.png", "inputs.json", "plan.json",
        "scenes.json", "timings.json", "world.json",
    ]  # fmt: skip
    assert list(folder.parent.iterdir()) == [folder]  # nothing is left beside it


def test_the_same_files_give_the_same_bytes(files: PlanFiles, tmp_path: Path) -> None:
    write_folder(plan_bytes(files), tmp_path / "a")
    write_folder(plan_bytes(files), tmp_path / "b")
    assert content(tmp_path / "a") == content(tmp_path / "b")


def test_an_old_plan_is_replaced_whole(files: PlanFiles, tmp_path: Path) -> None:
    folder = tmp_path / "x.plan"
    write_folder(plan_bytes(files), folder)
    assert "images/grasp.png" in content(folder)
    write_folder(plan_bytes(replace(files, images={})), folder)
    assert "images/grasp.png" not in content(folder)
    assert list(tmp_path.iterdir()) == [folder]


def test_an_empty_folder_is_taken(files: PlanFiles, tmp_path: Path) -> None:
    (tmp_path / "x.plan").mkdir()
    write_folder(plan_bytes(files), tmp_path / "x.plan")
    assert "plan.json" in content(tmp_path / "x.plan")


def test_a_foreign_folder_is_left_alone(files: PlanFiles, tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.txt").write_text("years", encoding="utf-8")
    (tmp_path / "file").write_text("x", encoding="utf-8")
    for name in ("thesis", "file"):
        with pytest.raises(OutputError) as caught:
            write_folder(plan_bytes(files), tmp_path / name)
        assert caught.value.code == "MP701"
    assert content(tmp_path) == {"thesis/chapter.txt": b"years", "file": b"x"}


@pytest.mark.parametrize("name", ["NOTES.txt", "task.yaml", "journal.jsonl", "parts"])
def test_a_plan_among_other_things_is_left_alone(
    files: PlanFiles, tmp_path: Path, name: str
) -> None:
    folder = tmp_path / "x.plan"
    write_folder(plan_bytes(files), folder)
    (folder / name).write_text("years", encoding="utf-8")
    (folder / "report.html").write_text("ours", encoding="utf-8")
    before = content(folder)
    with pytest.raises(OutputError, match=name) as caught:
        write_folder(plan_bytes(files), folder)
    assert caught.value.code == "MP701"
    assert content(folder) == before
    (folder / name).unlink()
    write_folder(plan_bytes(files), folder)
    assert not (folder / "report.html").exists()  # it was of the plan before


@pytest.mark.parametrize(
    "name",
    ["images/my.png", "images/grasp", "images/my.grasp.png", "artifacts/notes.txt",
     "evidence/thesis/1.png", "evidence/grasped.json"],
)  # fmt: skip
def test_a_plan_with_other_things_in_its_own_folders_is_left_alone(
    files: PlanFiles, tmp_path: Path, name: str
) -> None:
    folder = tmp_path / "x.plan"
    write_folder(plan_bytes(files), folder)
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text("years", encoding="utf-8")
    before = content(folder)
    with pytest.raises(OutputError, match="not of the plan beside it") as caught:
        write_folder(plan_bytes(files), folder)
    assert caught.value.code == "MP701"
    assert content(folder) == before


@pytest.mark.parametrize(
    "text",
    [
        "", "{}", "[1]", "not json", '{"format_version": "2.0"}',
        # of a program that plans something else
        '{"format_version":"1.2","terraform_version":"1.9.0","planned_values":{}}',
        '{"format_version": "1.0", "name": "n", "status": "done", "reasons": []}',
    ],
)  # fmt: skip
def test_a_plan_of_another_program_is_left_alone(
    files: PlanFiles, tmp_path: Path, text: str
) -> None:
    folder = tmp_path / "x.plan"
    folder.mkdir()
    (folder / "plan.json").write_text(text, encoding="utf-8")
    with pytest.raises(OutputError, match="no plan of microplan") as caught:
        write_folder(plan_bytes(files), folder)
    assert caught.value.code == "MP701"
    assert content(folder) == {"plan.json": text.encode()}


def test_a_plan_that_is_no_file_is_left_alone(files: PlanFiles, tmp_path: Path) -> None:
    """A pipe would be waited for."""
    for name, make in (("pipe", os.mkfifo), ("folder", os.mkdir)):
        (tmp_path / name).mkdir()
        make(tmp_path / name / "plan.json")
        with pytest.raises(OutputError) as caught:
            write_folder(plan_bytes(files), tmp_path / name)
        assert caught.value.code == "MP701"


@pytest.mark.parametrize("indent", [None, 0, 2, 4])
def test_a_plan_written_in_another_way_is_a_plan(
    files: PlanFiles, tmp_path: Path, indent: int | None
) -> None:
    folder = tmp_path / "x.plan"
    write_folder(plan_bytes(files), folder)
    file = folder / "plan.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps(data, indent=indent), encoding="utf-8")
    write_folder(plan_bytes(files), folder)
    assert file.read_bytes() == plan_bytes(files).files["plan.json"]


def test_the_command_leaves_a_foreign_folder_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task = copy_example(tmp_path / "task")
    assert main(["compile", str(task), "-o", str(task.parent)]) == 2
    said = capsys.readouterr().err
    assert "error[MP701]" in said
    assert f"--> {task.parent}\n" in said  # what is at fault is not the task
    assert not (task.parent / "plan.json").exists()


def test_a_failed_write_leaves_the_old_plan(files: PlanFiles, tmp_path: Path) -> None:
    folder = tmp_path / "x.plan"
    write_folder(plan_bytes(files), folder)
    before = content(folder)
    made = plan_bytes(files)
    worse = {**made.files, f"images/{'a' * 300}.png": b"no file has such a name"}
    with pytest.raises(OutputError) as caught:
        write_folder(replace(made, files=worse), folder)
    assert caught.value.code == "MP702"
    # the folder that it is filled in before it is moved into place is not the user's
    assert str(caught.value) == f"{folder} cannot be written: File name too long"
    assert caught.value.file == str(folder)
    assert content(folder) == before
    assert list(tmp_path.iterdir()) == [folder]


def test_a_failed_move_into_place_brings_the_old_plan_back(
    files: PlanFiles, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "x.plan"
    write_folder(plan_bytes(files), folder)
    before = content(folder)
    rename = Path.rename

    def refuse(self: Path, target: Path) -> Path:
        if target == folder and not self.name.endswith(".old"):
            raise OSError("the disc is full")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", refuse)
    with pytest.raises(OutputError) as caught:
        write_folder(plan_bytes(files), folder)
    assert caught.value.code == "MP702"
    assert content(folder) == before
    assert list(tmp_path.iterdir()) == [folder]


def test_a_plan_that_may_not_be_a_folder_is_said_so(
    files: PlanFiles, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(OutputError) as caught:
        write_folder(plan_bytes(files), tmp_path / "file" / "x.plan")
    assert caught.value.code == "MP702"


def test_a_link_to_a_plan_becomes_the_plan(files: PlanFiles, tmp_path: Path) -> None:
    """What it led to is left alone."""
    write_folder(plan_bytes(files), tmp_path / "one.plan")
    link = tmp_path / "latest.plan"
    link.symlink_to("one.plan")
    write_folder(plan_bytes(files), link)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["latest.plan", "one.plan"]
    assert not link.is_symlink()
    assert (tmp_path / "one.plan" / "plan.json").is_file()


def test_an_impossible_place_is_refused_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task = copy_example(tmp_path / "task")
    for out in (tmp_path / ("n" * 300), task / "x.plan"):
        assert main(["compile", str(task), "-o", str(out)]) == 2
        said = capsys.readouterr().err
        assert "error[MP702]" in said
        assert said.endswith(f"--> {out}\n")


def test_a_folder_gives_its_plan(files: PlanFiles) -> None:
    made = plan_bytes(files)
    assert dump_plan(made.plan()) == dump_plan(files.plan)
    assert made.name == files.plan.name
    assert files.plan.status in made.summary


@pytest.mark.parametrize("path", ["../a.png", "images/../../a.png", "/a.png"])
def test_a_folder_holds_nothing_that_lies_elsewhere(
    files: PlanFiles, path: str
) -> None:
    made = plan_bytes(files)
    with pytest.raises(ValueError, match="outside"):
        replace(made, files={**made.files, path: b""})
    with pytest.raises(ValueError, match="plan"):
        replace(made, files={"images/grasp.png": b""})


def test_files_take_the_place_of_older_ones_whole(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "compared"
    write_files(folder, {})
    assert content(tmp_path) == {}
    assert folder.is_dir()
    (folder / "mine.txt").write_text("years")
    for data in (b"step,time_s", b"step"):
        write_files(folder, {"task.csv": data})
        assert content(folder) == {"mine.txt": b"years", "task.csv": data}
    with pytest.raises(OutputError) as caught:
        write_files(folder / "mine.txt", {"task.csv": b""})
    assert caught.value.code == "MP702"
