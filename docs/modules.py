"""Keep the list of modules in architecture.md true: python docs/modules.py."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "architecture.md"
PACKAGES = ("planner", "executor", "featuresel", "optics", "schemas", "benchmarks")
BEGIN, END = "<!-- modules: begin -->", "<!-- modules: end -->"


def listing() -> str:
    """Return one table per folder: every module with its docstring's first line."""
    blocks = []
    for package in PACKAGES:
        for folder in _folders(ROOT / package):
            name = folder.relative_to(ROOT).as_posix()
            head = _first_line(folder / "__init__.py")
            lines = [f"### `{name}/`", "", head, "", "| module | holds |", "|---|---|"]
            for file in sorted(folder.glob("*.py")):
                if file.name != "__init__.py":
                    lines.append(f"| `{file.name}` | {_first_line(file)} |")
            blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


def with_listing(text: str) -> str:
    """Return the page with what stands between the marks replaced by the listing."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n\n{listing()}\n\n{END}{after}"


def _folders(folder: Path) -> Iterator[Path]:
    """Yield a package and the packages in it, sorted."""
    yield folder
    for inner in sorted(folder.iterdir()):
        if (inner / "__init__.py").is_file():
            yield from _folders(inner)


def _first_line(file: Path) -> str:
    """Return the first line of a module's docstring, fit for a table."""
    text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8")))
    if not text:
        raise ValueError(f"{file} has no docstring")
    return text.splitlines()[0].replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(with_listing(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    sys.exit(0)
