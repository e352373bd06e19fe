"""The documentation's index, the README's output, and what pages promise of others."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from microplan.planner.store.summary import plan_summary
from microplan.schemas.plan import parse_plan
from tests.project.walk import Said, calls

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
GOLDEN = ROOT / "tests" / "golden" / "gear_on_shaft.fast.json"
# folders whose own README lists their pages
LISTED = ("diagnostics", "decisions")

PAGES = sorted(
    page.relative_to(DOCS).as_posix()
    for page in DOCS.rglob("*.md")
    if page.parent.name not in LISTED and page != DOCS / "README.md"
)


def links(page: Path) -> set[Path]:
    """Return the files that a page links to."""
    found = re.findall(r"\]\(([^)#:]+)[^)]*\)", page.read_text(encoding="utf-8"))
    return {(page.parent / target).resolve() for target in found}


@pytest.mark.parametrize("page", PAGES)
def test_every_page_is_in_the_index(page: str) -> None:
    assert (DOCS / page).resolve() in links(DOCS / "README.md")


def test_the_index_leads_to_the_lists_of_pages() -> None:
    found = links(DOCS / "README.md")
    assert all((DOCS / name / "README.md").resolve() in found for name in LISTED)


def test_every_picture_is_shown_somewhere() -> None:
    shown = links(ROOT / "README.md").union(*(links(p) for p in DOCS.rglob("*.md")))
    pictures = set((DOCS / "images").resolve().iterdir())
    assert pictures - shown == set()
    assert (DOCS / "images" / "overview.png").stat().st_size < 250_000


def test_the_readme_is_short_and_shows_the_present_output() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert text.count("\n") < 150
    (block,) = re.findall(r"^```\n(\$ \S*microplan compile .*?)^```", text, re.M | re.S)
    ((command, expected),) = calls(block)
    assert "--preset fast" in command  # as the golden plan is
    plan = parse_plan(GOLDEN.read_text(encoding="utf-8"))
    printed = (*plan_summary(plan).splitlines(), "plan folder: build/plan")
    said = Said(command=command, expected=expected, printed=printed, status=0)
    assert len(expected) > 8
    assert said.missing() == []
