"""Find the files that a file names: relative to it, never outside its folder."""

from __future__ import annotations

from pathlib import Path

from planner.diagnostics import Report
from planner.inputs.source import Key, Source


def named_file(source: Source, *where: Key, report: Report) -> tuple[Path, str] | None:
    """Return the path named at `where` and how to call it, or None if it is outside.

    Links count by where they lead. The name is `source`'s own folder, as the user
    wrote it, with the reference added.
    """
    at = source.value(*where)
    text: str = source.get(*where)
    folder = source.path.parent
    inside = False
    try:
        # a path with a root or a drive leaves the folder here
        inside = (folder / text).resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # loops, odd characters
        report.error("MP010", at, f"'{text}' is no usable path: {error}")
        return None
    if not inside or Path(text).is_absolute() or "\\" in text:
        message = f"'{text}' leads out of the folder of {source.file}"
        hint = "keep the file in that folder, name it with / and without .."
        report.error("MP010", at, message, hint)
        return None
    return folder / text, (Path(source.file).parent / text).as_posix()
