"""The commands of the tutorial and the how-to guides do what their pages say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from microplan.planner.task.presets import PRESETS
from tests.project.walk import PROGRAMS, Said, alike, walk

DOCS = Path(__file__).parents[2] / "docs"

PAGES = ("tutorial-own-part.md", "howto-driver.md", "howto-not-found.md")
# Fewer trials of a look: what its page does not tell, and of the rest nearly as many.
FEW = replace(
    PRESETS["fast"], trials=8, random_trials=52, range_draws=10, drift_draws=1
)


def spend_less(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let compiles try fewer images and runs take quick pictures: the same lines."""
    monkeypatch.setitem(PRESETS, "fast", FEW)
    run = PROGRAMS["microplan-run"]
    quick = ["--camera", "quick"]
    monkeypatch.setitem(PROGRAMS, "microplan-run", lambda words: run([*words, *quick]))


@pytest.fixture
def said(
    page: str,
    whole: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> list[Said]:
    """Return what the commands of a page printed, run in a folder of their own."""
    folder = tmp_path / "own"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    if not whole:
        spend_less(monkeypatch)

    def read() -> str:
        out, err = capsys.readouterr()
        return out + err

    return list(walk(DOCS / page, folder, read))


@pytest.mark.parametrize("page", PAGES)
@pytest.mark.parametrize(
    "whole", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["soon", "whole"]
)
def test_every_command_prints_what_the_page_says(said: list[Said]) -> None:
    assert said
    for call in said:
        assert call.missing() == [], "\n".join((call.command, *call.printed))
        words = " ".join(call.expected)
        status = 2 if "error[" in words else 1 if "infeasible[" in words else 0
        assert call.status == status, "\n".join((call.command, *call.printed))


@pytest.mark.parametrize(
    ("line", "other", "same"),
    [
        ("sigma 0.35 um", "sigma  0.36 um", True),
        ("sigma 0.35 um", "sigma 0.5 um", False),
        ("by ncc at 6.9 x", "by otsu at 6.9 x", False),
        ("focus -40..+40 um", "focus -40..+40 um", True),
        ("focus -40..+40 um", "focus +40..+40 um", False),
        ("find_gear  ok", "find_gear  failed", False),
    ],
)
def test_words_are_compared_exactly_and_numbers_nearly(
    line: str, other: str, same: bool
) -> None:
    assert alike(line, other) is same
