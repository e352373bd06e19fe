"""microplan init: a task that compiles, ready to edit."""

from __future__ import annotations

from pathlib import Path

from planner.outputs.errors import OutputError
from planner.outputs.shipped import starter


def write_starter(folder: Path) -> str:
    """Write the example's task, workcell and drawings; return what to do next.

    Nothing that exists is overwritten.

    Raises
    ------
    OutputError
        MP703 if the folder holds one of the files already, MP702 if it cannot be
        written.
    """
    files = dict(starter())
    try:
        there = [name for name in files if (folder / name).exists()]
        if there:
            raise OutputError("MP703", f"{folder} already has {', '.join(there)}")
        for name, content in files.items():
            file = folder / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
    except OSError as error:
        raise OutputError("MP702", f"cannot write {folder}: {error.strerror}") from None
    task = folder / "task.yaml"
    return (
        f"{task} and {len(files) - 1} files beside it; next:\n  microplan check {task}"
    )
