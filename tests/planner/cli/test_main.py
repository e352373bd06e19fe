"""The command microplan: exit statuses, and what it loads."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from microplan.planner.cli.main import main
from microplan.planner.source.diagnostics import TITLES
from microplan.schemas.files.json_schema import NAMES, load
from tests.planner.examples import EXAMPLE, ONE_LOOK, change, copy_example, cut

TASK = str(EXAMPLE / "task.yaml")
PYPROJECT = Path(__file__).parents[3] / "pyproject.toml"


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["build", TASK],
        ["check"],
        ["check", TASK, "--fast"],
        ["compile", TASK, "--jobs", "0"],
        ["compile", TASK, "--jobs", "two"],
        ["compile", TASK, "--preset", "best"],
        ["compile", TASK, "--max-image-error", "1.01"],
        ["compile", TASK, "--max-image-error", "nan"],
        ["render", TASK, "--step", "find_gear"],
        ["render", TASK, "-o", "x.png"],
    ],
    ids=" ".join,
)
def test_a_wrong_call_ends_with_two(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    captured = capsys.readouterr()
    assert "usage: microplan" in captured.err
    assert captured.out == ""


@pytest.mark.parametrize("words", [["--help"], ["compile", "--help"]])
def test_help_ends_with_zero(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 0
    assert "usage: microplan" in capsys.readouterr().out


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    pyproject = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"microplan {pyproject['project']['version']}\n"


def test_the_bare_command_names_what_there_is(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([]) == 2
    assert "what changed between two plans" in capsys.readouterr().err


def test_check_says_what_the_task_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", TASK]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith(
        "gear-on-shaft: 13 steps, 8 looks, parts gear, shaft_plate\ngear: 100 x"
    )
    assert "error" not in captured.err
    assert "infeasible" not in captured.err


def test_check_tells_a_fault_from_a_no(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = copy_example(tmp_path / "task")
    cut(file, ONE_LOOK)
    change(file.with_name("workcell.yaml"), "min_um: -500, max_um: 500",
           "min_um: -500, max_um: 100")  # fmt: skip
    assert main(["check", str(file)]) == 1
    assert "infeasible[MP402]" in capsys.readouterr().err
    change(file, "seed: 1998", "sead: 1998")
    assert main(["check", str(file)]) == 2
    assert "did you mean 'seed'?" in capsys.readouterr().err
    assert main(["check", str(tmp_path / "nowhere.yaml")]) == 2


def test_numpy_is_loaded_after_its_threads_are_limited() -> None:
    # with several threads sums come in another order, and the plan's bytes with them
    script = "import sys, microplan.planner.cli.main; sys.exit('numpy' in sys.modules)"
    call = [sys.executable, "-c", script]
    assert subprocess.run(call, check=False).returncode == 0


def test_check_loads_no_imaging_library_and_no_scipy() -> None:
    script = (
        "import sys; from microplan.planner.cli.main import main\n"
        "status = main(sys.argv[1:])\n"
        "heavy = ('cv2', 'scipy', 'skimage', 'ezdxf',\n"
        "         'microplan.optics.render.render',\n"
        "         'microplan.featuresel.trials.trials')\n"
        "print([name for name in heavy if name in sys.modules]); sys.exit(status)"
    )
    for words in (["check", TASK], ["--help"]):
        done = subprocess.run(
            [sys.executable, "-c", script, *words],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert done.stdout.splitlines()[-1] == "[]"


def test_a_bug_ends_with_seventy_and_says_so(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def broken(self: Path, *args: object, **kwargs: object) -> bytes:
        raise RuntimeError("the disc melted")

    monkeypatch.delenv("MICROPLAN_TRACEBACK", raising=False)
    monkeypatch.setattr(Path, "read_bytes", broken)
    monkeypatch.setattr(Path, "open", broken)
    assert main(["check", TASK]) == 70
    assert "bug in microplan: RuntimeError: the disc melted" in capsys.readouterr().err


def test_check_draws_the_parts(tmp_path: Path) -> None:
    assert main(["check", TASK, "-o", str(tmp_path)]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["gear.svg", "shaft_plate.svg"]
    assert main(["check", TASK, "-o", str(tmp_path)]) == 0  # over older ones


def test_check_leaves_another_drawing_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = '<svg xmlns="http://www.w3.org/2000/svg"><title>mine</title></svg>'
    (tmp_path / "gear.svg").write_text(mine)
    assert main(["check", TASK, "-o", str(tmp_path)]) == 2
    assert "error[MP703]" in capsys.readouterr().err
    assert (tmp_path / "gear.svg").read_text() == mine


@pytest.mark.parametrize("form", ["json", "github", "sarif"])
def test_a_form_for_machines_is_all_on_standard_output(
    form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = copy_example(tmp_path / "task")
    change(file, "seed: 1998", "sead: 1998")
    assert main(["check", str(file), "--format", form]) == 2
    captured = capsys.readouterr()
    assert "MP104" in captured.out
    assert "did you mean 'seed'?" in captured.out
    assert captured.err == ""


def test_a_call_that_cannot_be_met_is_a_finding_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "look.gif")
    words = ["render", TASK, "--step", "find_gear", "-o", out, "--format", "json"]
    assert main(words) == 2
    found = json.loads(capsys.readouterr().out)["findings"]
    assert [f["code"] for f in found if f["severity"] == "error"] == ["MP702"]


def test_explain_shows_a_page_or_all_codes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "404"]) == 0
    assert "MP404" in capsys.readouterr().out
    assert main(["explain", "mp404"]) == 0
    assert capsys.readouterr().out.startswith("# MP404: nothing to render\n")
    assert main(["explain"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(TITLES)
    for wrong in ("MP999", "../README", "", "MP404.md"):
        assert main(["explain", wrong]) == 2
        assert "microplan explain lists all" in capsys.readouterr().err


def test_init_writes_a_task_that_checks_and_overwrites_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "new" / "job"
    assert main(["init", str(folder)]) == 0
    assert f"microplan check {folder / 'task.yaml'}" in capsys.readouterr().out
    assert main(["check", str(folder / "task.yaml")]) == 0
    change(folder / "task.yaml", "seed: 1998", "seed: 2")
    before = (folder / "task.yaml").read_bytes()
    assert main(["init", str(folder)]) == 2
    assert "error[MP703]" in capsys.readouterr().err
    assert (folder / "task.yaml").read_bytes() == before
    (tmp_path / "file").write_text("x")
    assert main(["init", str(tmp_path / "file")]) == 2
    assert "error[MP702]" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["task", "workcell"])
def test_what_init_writes_names_a_schema_that_lies_beside_it(
    name: str, tmp_path: Path
) -> None:
    assert main(["init", str(tmp_path / "job")]) == 0
    file = tmp_path / "job" / f"{name}.yaml"
    first = file.read_text(encoding="utf-8").splitlines()[0]
    before, _, place = first.partition("$schema=")
    assert before == "# yaml-language-server: "
    assert "//" not in place  # found without a network
    schema = json.loads((file.parent / place).read_text(encoding="utf-8"))
    assert schema == load(name)


@pytest.mark.parametrize("name", NAMES)
def test_schema_prints_a_format(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema", name]) == 0
    assert json.loads(capsys.readouterr().out) == load(name)


def test_a_reader_that_leaves_is_no_bug() -> None:
    script = (
        "import sys; from microplan.planner.cli.main import main; "
        "sys.exit(main(['explain']))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("words", "instead"),
    [
        (["migrate", TASK], "microplan check"),
        (["migrate"], "microplan check"),
        (["compile", TASK, "--watch", "-o", "x"], "microplan compile"),
    ],
)
def test_what_is_no_more_names_what_to_use_instead(
    words: list[str], instead: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    captured = capsys.readouterr()
    assert instead in captured.err
    assert len(captured.err.splitlines()) == 1
    assert captured.out == ""
