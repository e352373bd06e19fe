"""The command microplan: exit statuses, and what it loads."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from planner.cli import main
from tests.planner.examples import EXAMPLE, ONE_LOOK, change, copy_example, cut

TASK = str(EXAMPLE / "task.yaml")


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
        ["compile", TASK, "--max-image-error", "1"],
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


def test_check_says_what_the_task_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", TASK]) == 0
    captured = capsys.readouterr()
    assert captured.out == (
        "gear-on-shaft: 12 steps, 8 looks, parts gear, shaft_plate\n"
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


def test_check_loads_no_imaging_library_and_no_scipy() -> None:
    script = (
        "import sys; from planner.cli import main; status = main(sys.argv[1:])\n"
        "heavy = ('cv2', 'scipy', 'skimage', 'featuresel.trials', 'optics.render')\n"
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
