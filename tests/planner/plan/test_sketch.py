"""Sketches: pictures and findings of a task, and nothing that trials would show."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from microplan.planner.cli.main import main
from microplan.planner.diff.compare import compare_plans
from microplan.planner.diff.pictures import decoded
from microplan.planner.report.folder import read_folder
from microplan.planner.report.report import plan_report
from microplan.planner.store.pictures import picture_sha256
from microplan.schemas.files import json_schema
from microplan.schemas.plan import Plan, parse_plan
from tests.pages import check_page
from tests.planner.examples import ROOT, change, copy_example

GOLDEN = ROOT / "tests" / "golden" / "gear_on_shaft.fast.json"
# P, sigma and what is made of them, but not what the task itself states
CLAIMS = re.compile(r"P\(success\)|\bsigma\b|\bP \d|feasible", re.IGNORECASE)

Sketch = Callable[..., int]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the plan folder of the example's sketch, made without a trial."""
    top = tmp_path_factory.mktemp("sketch")
    words = ["compile", str(copy_example(top / "task")), "--preset", "sketch"]

    def tried(*_args: Any, **_options: Any) -> None:
        raise AssertionError("a sketch has no trials")

    with pytest.MonkeyPatch.context() as patch:
        for name in ("exposed", "nominal_render"):
            patch.setattr(f"microplan.featuresel.trials.trials.{name}", tried)
        patch.setattr("microplan.planner.looks.look_problem.compare_routines", tried)
        assert main([*words, "--no-cache", "-o", str(top / "p")]) == 0
    return top / "p"


@pytest.fixture(scope="module")
def plan(folder: Path) -> Plan:
    """Return the example's sketch."""
    return parse_plan((folder / "plan.json").read_text(encoding="utf-8"))


@pytest.fixture
def sketch(tmp_path: Path) -> Sketch:
    """Return what sketches a copy of the example after a change."""
    task = copy_example(tmp_path / "task")

    def run(old: str = "", new: str = "", *words: str) -> int:
        if old:
            change(task, old, new)
        out = ["-o", str(tmp_path / "new")]
        return main(["compile", str(task), "--preset", "sketch", *out, *words])

    return run


def test_a_sketch_fits_the_schema_and_has_no_step(plan: Plan, folder: Path) -> None:
    data = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(json_schema.load("plan")).validate(data)
    assert (plan.status, plan.steps, plan.success_bound) == ("sketch", (), None)
    assert plan.provenance.preset == "sketch"


def test_its_looks_are_those_of_a_compile_at_the_same_setting(
    plan: Plan, folder: Path
) -> None:
    """The golden plan was compiled with all trials; same view, same picture."""
    golden = parse_plan(GOLDEN.read_text(encoding="utf-8"))
    looks = {look.id: look for step in golden.steps for look in step.looks}
    assert [look.id for look in plan.sketched] == list(looks)
    for look in plan.sketched:
        want = looks[look.id]
        assert look.target == want.target
        assert look.view.magnification == want.view.magnification
        assert look.view.focus_um == want.view.focus_um
        assert look.scene == want.scene
        pixels = decoded((folder / look.scene.image).read_bytes())
        assert pixels is not None
        assert picture_sha256(pixels) == look.scene.image_sha256


def test_its_answer_is_that_p_is_not_shown(
    sketch: Sketch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sketch() == 0
    out = capsys.readouterr().out
    assert out.startswith("gear-on-shaft: sketch: P not shown\n")
    assert "find_gear" in out
    assert not CLAIMS.search(out)
    assert sketch() == 0  # a sketch is replaced by another
    assert capsys.readouterr().out == out


def test_what_needs_no_trials_counts_against_it(
    sketch: Sketch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A tolerance finer than the axes can meet."""
    assert sketch("tolerance_xy_um: 3}", "tolerance_xy_um: 0.001}") == 1
    said = capsys.readouterr()
    assert "MP603" in said.err
    assert "infeasible; sketch: P not shown" in said.out
    plan = parse_plan((tmp_path / "new" / "plan.json").read_text(encoding="utf-8"))
    assert plan.status == "infeasible"
    assert len(plan.sketched) == 8


def test_a_fit_that_cannot_be_stays_infeasible_and_can_be_compiled_again(
    sketch: Sketch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The post is 60 um thick, the bore 50 um wide; a picture shows the overlap."""
    change(tmp_path / "task" / "parts" / "shaft_plate.dxf", "22.0", "30.0")
    for _ in range(2):
        assert sketch() == 1
        assert "MP601" in capsys.readouterr().err
        assert (tmp_path / "new" / "fits" / "insert.png").is_file()


def test_its_report_shows_every_picture_and_no_claim(folder: Path) -> None:
    read = read_folder(folder)
    page = check_page(plan_report(read))
    text = " ".join(page.text)
    assert "Sketch" in text
    assert "P not shown" in text
    for look in read.plan.sketched:
        assert f"Look {look.id}: {look.target}" in text
    assert not CLAIMS.search(text.partition("Findings")[0])


def test_a_picture_of_another_plan_is_not_shown(folder: Path, tmp_path: Path) -> None:
    read = read_folder(folder)
    first, second = (look.scene.image for look in read.plan.sketched[:2])
    data = (folder / first).read_bytes()
    try:
        (folder / first).write_bytes((folder / second).read_bytes())
        assert f"{first} is not the image" in plan_report(read_folder(folder))
    finally:
        (folder / first).write_bytes(data)


def test_a_comparison_has_no_chance_of_a_sketch(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["diff", str(GOLDEN), str(folder), "--no-images"]
    assert main(words) == 1
    said = capsys.readouterr().out
    assert "P(success) 0.9977 before, not shown now" in said or "not shown" in said
    assert main([*words, "--format", "json"]) == 1
    verdicts = json.loads(capsys.readouterr().out)["verdicts"]
    assert verdicts["new"] == {"status": "sketch", "success_probability": None}
    assert verdicts["old"]["success_probability"] == pytest.approx(0.9977, abs=1e-4)


def test_no_status_is_better_than_a_sketch(plan: Plan) -> None:
    golden = parse_plan(GOLDEN.read_text(encoding="utf-8"))
    trends = {c.path: c for c in compare_plans(golden, plan)}
    (status,) = (c for path, c in trends.items() if tuple(path) == ("status",))
    assert status.trend == ""
    # one has what trials tell, the other has not: that is no change
    told = {path[0] for path in trends}
    assert told <= {"status", "provenance"}


def test_no_confidence_is_shown_without_trials(
    sketch: Sketch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sketch("", "", "--confidence", "0.95") == 2
    assert "--confidence" in capsys.readouterr().err


def test_no_task_prefers_a_sketch(
    sketch: Sketch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sketch("prefer: balanced ", "prefer: sketch ") == 2
    assert "fast" in capsys.readouterr().err


@pytest.mark.parametrize("to", ["json", "useq"])
def test_a_sketch_has_no_look_to_export(
    to: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "out.json")
    assert main(["export", str(folder), "--to", to, "-o", out]) == 2
    assert "MP720" in capsys.readouterr().err


def test_a_tradeoff_compiles_no_sketch(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task = str(copy_example(tmp_path / "task"))
    assert main(["tradeoff", task, "--vary", "preset=sketch"]) == 2
    assert "preset must be fast, balanced, accurate" in capsys.readouterr().err
