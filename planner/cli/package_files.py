"""Files that come with the package: pages on findings, and a task to begin with."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

_PACKAGE = Path(__file__).parents[1]
_CHECKOUT = Path(__file__).resolve().parents[2]  # beyond the links in microplan/
# in a wheel, and where they are kept in the source tree
_PLACES = {
    "pages": (_PACKAGE / "pages", _CHECKOUT / "docs" / "diagnostics"),
    "starter": (_PACKAGE / "starter", _CHECKOUT / "examples" / "gear_on_shaft"),
}
_STARTER = ("task.yaml", "workcell.yaml", "parts")


def page(code: str) -> str | None:
    """Return the page of a code such as MP104 or 104, None if there is none."""
    name = code.strip().upper()
    name = f"MP{name}" if name.isdecimal() else name
    file = _folder("pages") / f"{name}.md"
    known = name.isalnum() and file.is_file()
    return file.read_text(encoding="utf-8") if known else None


def codes() -> list[str]:
    """Return the codes that have a page, in order."""
    return sorted(file.stem for file in _folder("pages").glob("MP*.md"))


def starter() -> Iterator[tuple[str, bytes]]:
    """Yield path and content of every file of a task that compiles."""
    folder = _folder("starter")
    for name in _STARTER:
        top = folder / name
        files = sorted(top.iterdir()) if top.is_dir() else [top]
        for file in files:
            yield file.relative_to(folder).as_posix(), file.read_bytes()


def _folder(name: str) -> Path:
    """Return where files of one kind lie."""
    return next(place for place in _PLACES[name] if place.is_dir())
