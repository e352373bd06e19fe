"""Subcommands for what comes with the package: init, explain, schema."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

from microplan.planner.cli.answering import BAD_INPUT, DONE
from microplan.planner.source.diagnostics import TITLES
from microplan.planner.store.folder import OutputError, not_written
from microplan.schemas.files.json_schema import load
from microplan.schemas.page.console import say, tell

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


# files that people edit, and the schema that each obeys
_SCHEMAS = {"task.yaml": "task", "workcell.yaml": "workcell"}


def write_starter(folder: Path) -> str:
    """Write the example's task, workcell and drawings; return what to do next.

    Next to them are the schemas of task and workcell, which the first line of each file
    names: editors that know YAML's language server explain and check keys by them,
    without a network. Nothing that exists is overwritten.

    Raises
    ------
    OutputError
        MP703 if the folder holds one of the files already, MP702 if it cannot be
        written.
    """
    files = dict(_files())
    try:
        there = [name for name in files if (folder / name).exists()]
        if there:
            message = f"{folder} already has {', '.join(there)}"
            raise OutputError("MP703", message, folder)
        for name, content in files.items():
            file = folder / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
    except OSError as error:
        raise not_written(folder, error) from None
    task = folder / "task.yaml"
    return (
        f"{task} and {len(files) - 1} files beside it; next:\n  microplan check {task}"
    )


def _files() -> Iterator[tuple[str, bytes]]:
    """Yield path and content of every file, those to edit with their schemas."""
    for name, content in starter():
        if name in _SCHEMAS:
            schema = f"schemas/{_SCHEMAS[name]}.schema.json"
            text = json.dumps(load(_SCHEMAS[name]), indent=2, ensure_ascii=False)
            yield schema, f"{text}\n".encode()
            modeline = f"# yaml-language-server: $schema={schema}\n"
            yield name, modeline.encode() + content
        else:
            yield name, content


def init(call: argparse.Namespace) -> int:
    """Write a task that compiles into a folder."""
    try:
        say(write_starter(call.folder))
    except OutputError as error:
        tell(f"error[{error.code}]: {error}")
        return BAD_INPUT
    return DONE


def explain(call: argparse.Namespace) -> int:
    """Print the page of a code, or all codes."""
    if call.code is None:
        listed = (f"{code}  {title}" for code, title in TITLES.items())
        say("\n".join(listed))
        return DONE
    text = page(call.code)
    if text is None:
        tell(f"no code {call.code!r}; microplan explain lists all")
        return BAD_INPUT
    say(text.rstrip())
    return DONE


def schema(call: argparse.Namespace) -> int:
    """Print a JSON Schema."""
    say(json.dumps(load(call.name), indent=2, ensure_ascii=False))
    return DONE
