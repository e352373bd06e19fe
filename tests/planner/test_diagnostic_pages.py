"""Every diagnostic has a page, and the page's example leads to its code."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from planner.diagnostics import TITLES, Report
from planner.inputs.read_task import load_task
from planner.model.steps import unfold

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "diagnostics"
EXAMPLE = ROOT / "examples" / "gear_on_shaft"

_BLOCK = re.compile(r"^```(diff|write) (\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def _load(folder: Path) -> Report:
    report = Report()
    load_task(folder / "task.yaml", report)
    return report


def _unfold(folder: Path) -> Report:
    report = Report()
    task = load_task(folder / "task.yaml", report)
    assert task is not None
    unfold(task, report)
    return report


# first characters of a code -> what finds it in the example's folder
RUNNERS: dict[str, Callable[[Path], Report]] = {
    "MP0": _load,
    "MP1": _load,
    "MP2": _load,
    "MP3": _unfold,
}
CODES = sorted(page.stem for page in PAGES.glob("MP[0-7]*.md"))


def apply_page(page: str, folder: Path) -> None:
    """Change the example in `folder` as the blocks of a page say."""
    blocks = _BLOCK.findall(page)
    assert blocks, "the page has no example"
    for kind, name, body in blocks:
        file = folder / name
        if kind == "write":
            file.write_bytes(_raw(body))
            continue
        lines = body.splitlines()
        old = "\n".join(line[1:] for line in lines if line.startswith("-"))
        new = "\n".join(line[1:] for line in lines if line.startswith("+"))
        before = file.read_bytes()
        assert old, "a diff block takes something away"
        assert _raw(old) in before, f"{name} does not hold {old!r}"
        file.write_bytes(before.replace(_raw(old), _raw(new), 1))


def _raw(text: str) -> bytes:
    """Return `text` as UTF-8, with \\xNN as one byte."""
    return re.sub(
        rb"\\x([0-9a-f]{2})",
        lambda match: bytes.fromhex(match[1].decode()),
        text.encode(),
    )


@pytest.fixture
def example(tmp_path: Path) -> Path:
    """Return a copy of the example that may be spoilt."""
    return Path(shutil.copytree(EXAMPLE, tmp_path / "example"))


@pytest.mark.parametrize("code", CODES)
def test_the_example_of_a_page_leads_to_its_code(code: str, example: Path) -> None:
    assert RUNNERS[code[:3]](example).found == []
    apply_page((PAGES / f"{code}.md").read_text(encoding="utf-8"), example)
    found = RUNNERS[code[:3]](example).in_order
    assert code in {finding.code for finding in found}
    assert all(finding.where.line for finding in found if finding.code != "MP011")


@pytest.mark.parametrize("code", CODES)
def test_a_page_is_headed_by_its_code_and_title(code: str) -> None:
    page = (PAGES / f"{code}.md").read_text(encoding="utf-8")
    assert page.startswith(f"# {code}: {TITLES[code]}\n\n")
    assert "## How to mend it" in page


def test_every_code_of_the_readers_has_a_title_and_a_page() -> None:
    used = set()
    for module in (ROOT / "planner" / "inputs").glob("*.py"):
        used |= set(re.findall(r'"(MP\d{3})"', module.read_text(encoding="utf-8")))
    readers = ("MP0", "MP1", "MP2")
    assert used == {code for code in TITLES if code.startswith(readers)}
    assert used == {code for code in CODES if code.startswith(readers)}
