"""What pages name exists, their lines are short, and they stay few in words."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WIDTH = 120  # of lines of prose
MOST_WORDS = 85_000  # of all pages in docs/; rules of tables are none
PACKAGES = "planner|executor|featuresel|optics|schemas"
# entry points and modules of a user's own
EXAMPLES = {"microplan.drivers", "microplan.featuresel.routines.grey_centroid"}

NAMING = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
PAGES = [ROOT / "CHANGELOG.md", *NAMING]


def _name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def _exists(dotted: str) -> bool:
    """Return whether a dotted name is a folder, a module or a name in one."""
    parts = dotted.split(".")[1:]  # folders lie beside microplan/
    for end in range(len(parts), 0, -1):
        base = ROOT.joinpath(*parts[:end])
        if base.is_dir() and end == len(parts):
            return True
        home = base / "__init__.py" if base.is_dir() else base.with_suffix(".py")
        if home.is_file():
            text = home.read_text(encoding="utf-8")
            return all(re.search(rf"\b{name}\b", text) for name in parts[end:])
    if (ROOT / "microplan" / f"{parts[0]}.py").is_file():
        return True
    text = (ROOT / "microplan" / "__init__.py").read_text(encoding="utf-8")
    return len(parts) == 1 and f'"{parts[0]}"' in text


def _prose(text: str) -> list[str]:
    """Return the lines outside of tables and code, web addresses left out."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    lines = re.sub(r"https?://[^\s)]+", "", text).splitlines()
    return [line for line in lines if not re.match(r"    |\s*\|[ -]", line)]


@pytest.mark.parametrize("page", NAMING, ids=_name)
def test_every_file_and_dotted_name_of_a_page_exists(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    files = re.findall(r"(?<![\w/.<>-])((?:[\w-]+/)+[\w-]+\.py)\b", text)
    assert [file for file in files if not (ROOT / file).is_file()] == []
    folders = re.findall(rf"`((?:{PACKAGES})/[\w/]*)`", text)
    assert [name for name in folders if not (ROOT / name).exists()] == []
    dotted = set(re.findall(r"(?<![\w./])microplan(?:\.[A-Za-z_]\w*)+", text))
    assert [name for name in sorted(dotted - EXAMPLES) if not _exists(name)] == []


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_lines_of_prose_are_short(page: Path) -> None:
    lines = _prose(page.read_text(encoding="utf-8"))
    assert [line for line in lines if len(line) > WIDTH] == []


def test_the_pages_stay_few_in_words() -> None:
    pages = (ROOT / "docs").rglob("*.md")
    words = [w for p in pages for w in p.read_text(encoding="utf-8").split()]
    assert sum(any(c.isalnum() for c in word) for word in words) <= MOST_WORDS
