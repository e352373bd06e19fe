"""The wheel: what it holds, and that it works far from the repository."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.planner.examples import copy_example, one_look
from tests.planner.few_trials import EFFORT, few_main

ROOT = Path(__file__).parents[2]
PACKAGES = ("executor", "featuresel", "optics", "planner", "schemas")
HANG_S = 300  # ends a test that hangs; everything here takes seconds
# `microplan` as `few_main` has it, by what is installed
FEW_TRIALS = f"""import sys
from microplan.planner.cli.main import main
from microplan.planner.task.presets import PRESETS, Effort
PRESETS["fast"] = {EFFORT!r}
sys.exit(main(sys.argv[1:]))
"""


def _run(words: Sequence[str | Path], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command with nothing of this process's Python settings."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    return subprocess.run(
        [str(word) for word in words],
        cwd=folder,
        env=clean,
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=False,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Installed:
    """A fresh environment that holds the wheel, and a folder far from the sources."""

    bin: Path
    folder: Path

    def run(self, command: str, *words: str | Path) -> subprocess.CompletedProcess[str]:
        """Run a command of the environment in the folder."""
        return _run([self.bin / command, *words], self.folder)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the wheel, built without network."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation"]
    done = _run([*build, "--outdir", folder, ROOT], folder)
    assert done.returncode == 0, done.stdout + done.stderr
    (found,) = folder.glob("*.whl")
    return found


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """Return an environment with the wheel; it borrows the dependencies of this one."""
    home, folder = tmp_path_factory.mktemp("home"), tmp_path_factory.mktemp("far")
    venv.create(home, with_pip=False)
    python = home / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
    before, after = (_foreign(folder, name) for name in ("executor", "optics"))
    for file in (before, wheel, after):
        done = _run([*pip, "--no-deps", "--no-index", file], folder)
        assert done.returncode == 0, done.stdout + done.stderr
    (site,) = home.glob("lib/python*/site-packages")
    # a folder named here is searched, but the .pth files in it are not read: an
    # editable install of the sources stays out
    borrowed = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    (site / "borrowed.pth").write_text("\n".join(sorted(borrowed)) + "\n")
    _lend_machine_code(site / "microplan")
    return Installed(bin=home / "bin", folder=folder)


def _lend_machine_code(package: Path) -> None:
    """Let compiled loops be kept code of the sources: they take seconds to compile.

    It is taken for what is installed if the module has its size and time.
    """
    for code in (ROOT / "optics").rglob("__pycache__/*.nb[ic]"):
        module = code.parents[1] / f"{code.name.partition('.')[0]}.py"
        if not module.exists():
            continue  # it has another name now
        there = package / code.relative_to(ROOT)
        there.parent.mkdir(exist_ok=True)
        shutil.copy(code, there)
        times = module.stat()
        ns = (times.st_atime_ns, times.st_mtime_ns)
        os.utime(there.parents[1] / module.name, ns=ns)


def _foreign(folder: Path, name: str) -> Path:
    """Return the wheel of somebody else's package with one of our folders' names."""
    file = folder / f"{name}-9-py3-none-any.whl"
    info = f"{name}-9.dist-info"
    with zipfile.ZipFile(file, "w") as held:
        held.writestr(f"{name}/__init__.py", f"OWNER = 'the author of {name}'\n")
        held.writestr(f"{name}/cli.py", "")
        held.writestr(
            f"{info}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: 9\n"
        )
        held.writestr(
            f"{info}/WHEEL",
            "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        )
        held.writestr(f"{info}/RECORD", "")
    return file


def test_the_wheel_holds_microplan_and_nothing_else(wheel: Path) -> None:
    tops = {name.partition("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    (info,) = {top for top in tops if top.endswith(".dist-info")}
    assert tops - {info} == {"microplan"}


def test_the_wheel_holds_every_file_of_its_packages(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        f"microplan/{file.relative_to(ROOT).as_posix()}"
        for package in PACKAGES
        for kind in ("*.py", "*.json", "py.typed")
        for file in (ROOT / package).rglob(kind)
    }
    wanted |= {"microplan/__init__.py", "microplan/py.typed", "microplan/arrays.py"}
    assert {f"microplan/{package}/py.typed" for package in PACKAGES} <= wanted
    for name in ("task", "workcell"):
        assert f"microplan/schemas/{name}.schema.json" in wanted
    assert wanted <= names
    assert not [name for name in names if "__pycache__" in name]


def test_packages_of_the_same_names_harm_neither_side(installed: Installed) -> None:
    code = (
        "import json, executor, optics, microplan.executor.cli.main, microplan.optics\n"
        "print(json.dumps([executor.OWNER, optics.OWNER, microplan.__file__,\n"
        "                  microplan.optics.__file__, microplan.__path__]))\n"
    )
    done = installed.run("python", "-c", code)
    assert done.returncode == 0, done.stderr
    executor, optics, *files, path = json.loads(done.stdout)
    assert executor == "the author of executor"
    assert optics == "the author of optics"
    home = installed.bin.parent
    assert all(Path(file).is_relative_to(home) for file in [*files, *path])
    assert len(path) == 1


def test_what_is_installed_compiles_and_runs_beside_modules_of_the_same_names(
    installed: Installed,
) -> None:
    """One look of the example, byte for byte as by the sources; its plan runs."""
    task = copy_example(installed.folder / "poisoned")
    one_look(task)
    poison, words = task.parent, ("--preset", "fast", "--jobs", "1")
    by_sources = installed.folder / "by_sources"
    assert few_main(["compile", str(task), "-o", str(by_sources), *words]) == 0
    for package in PACKAGES:
        text = f"raise RuntimeError('this is not microplan.{package}')\n"
        (poison / f"{package}.py").write_text(text, encoding="utf-8")
    python = installed.bin / "python"
    compiler: list[str | Path] = [python, "-c", FEW_TRIALS, "compile"]
    compiled = _run(
        [*compiler, "task.yaml", "-o", "plan", *words, "--no-cache"], poison
    )
    assert compiled.returncode == 0, compiled.stderr
    plan = (poison / "plan" / "plan.json").read_bytes()
    assert plan == (by_sources / "plan.json").read_bytes()
    run = _run(
        [python, "-m", "microplan.executor.cli.main", "plan",
         "--station", "sim", "--camera", "quick", "--seed", "1", "--run-dir", "run"],
        poison,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert json.loads((poison / "run" / "summary.json").read_text("utf-8"))["done"]


@pytest.mark.parametrize("command", ["microplan", "microplan-run"])
def test_the_commands_start(installed: Installed, command: str) -> None:
    done = installed.run(command, "--help")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"usage: {command}")
    assert done.stderr == ""


def test_the_installed_compiler_reads_the_example(installed: Installed) -> None:
    example = installed.folder / "example"
    shutil.copytree(ROOT / "examples" / "gear_on_shaft", example, dirs_exist_ok=True)
    done = installed.run("microplan", "check", example / "task.yaml")
    assert done.returncode == 0, done.stderr


def test_the_installed_compiler_says_where_a_mistake_is(installed: Installed) -> None:
    task = installed.folder / "broken.yaml"
    task.write_text("microplan: 1\nnmae: x\n", encoding="utf-8")
    done = installed.run("microplan", "check", task)
    assert done.returncode == 2
    assert "broken.yaml:2:1" in done.stderr


def test_the_installed_compiler_brings_its_pages_and_a_task(
    installed: Installed,
) -> None:
    shown = installed.run("microplan", "explain", "MP104")
    page = ROOT / "docs" / "diagnostics" / "MP104.md"
    assert shown.stdout == page.read_text(encoding="utf-8")
    done = installed.run("microplan", "init", "mine")
    assert done.returncode == 0, done.stderr
    checked = installed.run("microplan", "check", Path("mine", "task.yaml"))
    assert checked.returncode == 0, checked.stderr
