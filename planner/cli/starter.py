"""microplan init: a task that compiles, ready to edit."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from microplan.planner.cli.package_files import starter
from microplan.planner.store.errors import OutputError, not_written
from microplan.schemas.files.json_schema import load

# files that people edit, and the schema that each obeys
_SCHEMAS = {"task.yaml": "task", "workcell.yaml": "workcell"}


def write_starter(folder: Path) -> str:
    """Write the example's task, workcell and drawings; return what to do next.

    Beside them lie the schemas of task and workcell, which the first line of each file
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
