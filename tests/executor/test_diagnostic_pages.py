"""Every code of the executor has a page, and the page's example leads to it."""

from __future__ import annotations

import re
import shlex
import shutil
from functools import partial
from pathlib import Path

import pytest

from microplan.executor.cli.main import main
from microplan.executor.devices.errors import CODES
from microplan.executor.devices.safety import Safety
from tests.executor.bench import Folder, assembly, world

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "diagnostics"
STATION = ROOT / "examples" / "stations" / "simulated.toml"
# need a hand on the keyboard, a look at several features, an angle of the seat, or a
# run that was killed, or one to replay: tested with those
UNTESTED = {
    "MP860", "MP826", "MP856", "MP876",
    "MP861", "MP862", "MP863", "MP864", "MP865", "MP866", "MP867",
}  # fmt: skip

_BLOCK = re.compile(r"^```(diff|remove|console) ?(\S*)\n(.*?)^```$", re.M | re.S)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the example's plan folder."""
    folder = tmp_path_factory.mktemp("plans") / "gear-on-shaft.plan"
    maker = Folder(folder)
    maker.write(assembly(maker), world())
    return folder


def page(code: str) -> str:
    return (PAGES / f"{code}.md").read_text(encoding="utf-8")


def options(code: str, plan: Path) -> list[str]:
    """Spoil the plan as the page says; return the call it shows, made to fit."""
    words: list[str] = []
    for kind, name, body in _BLOCK.findall(page(code)):
        if kind == "remove":
            (plan / name).unlink()
        elif kind == "diff":
            change(plan / name, body.splitlines())
        else:
            command, _, *words = shlex.split(body)
            assert command == "microplan-run"
    fits = {".": str(plan.parent), STATION.name: str(plan / STATION.name)}
    return [fits.get(word, word) for word in words]


def change(file: Path, lines: list[str]) -> None:
    """Replace what a diff takes away by what it adds, once."""
    old = "\n".join(line[1:] for line in lines if line.startswith("-"))
    new = "\n".join(line[1:] for line in lines if line.startswith("+"))
    text = file.read_text(encoding="utf-8")
    assert old in text, f"{file.name} does not hold {old!r}"
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


@pytest.mark.usefixtures("one_render_a_state")
@pytest.mark.parametrize("code", sorted(set(CODES) - UNTESTED))
def test_the_example_of_a_page_leads_to_its_code(
    code: str,
    built: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if code == "MP844":  # an answer that never comes is not waited for as long as usual
        monkeypatch.setattr(
            "microplan.executor.simulated.cell.Safety", partial(Safety, call_s=0.5)
        )
    plan = Path(shutil.copytree(built, tmp_path / "copy" / built.name))
    shutil.copy(STATION, plan)
    words = options(code, plan)
    if "--run-dir" not in words:
        words += ["--run-dir", str(tmp_path / "run")]
    if "sim" in words:
        words += ["--camera", "quick"]  # the same code, much sooner
    status = main([str(plan), *words, "--seed", "0", "--no-frames"])
    found = re.findall(r"^error\[(\w+)\]", capsys.readouterr().err, re.M)
    assert found == [code]
    assert status == CODES[code][1]


@pytest.mark.parametrize("code", sorted(CODES))
def test_a_page_is_headed_by_its_code_and_title(code: str) -> None:
    assert page(code).startswith(f"# {code}: {CODES[code][0]}\n\n")
    assert "## How to mend it" in page(code)


def test_there_is_a_page_for_every_code_and_no_other() -> None:
    assert {path.stem for path in PAGES.glob("MP8*.md")} == set(CODES)


def test_every_code_that_is_raised_is_in_the_table() -> None:
    used = set()
    for module in (ROOT / "executor").rglob("*.py"):
        used |= set(re.findall(r'"(MP\d{3})"', module.read_text(encoding="utf-8")))
    assert used == set(CODES)
