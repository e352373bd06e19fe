"""Files that a task names: found inside its folder, read once, up to a size."""

from __future__ import annotations

import difflib
import hashlib
from itertools import islice
from pathlib import Path

from microplan.planner.source.diagnostics import Report, Span

TASK = "task.yaml"  # as tasks are called
MOST_NAMES = 1000  # of a folder that are looked through for a similar one


def read_bytes(
    path: Path, file: str, at: Span, report: Report, *, most: int
) -> bytes | None:
    """Return what the file at `path` holds, or None after reporting why not.

    Parameters
    ----------
    path, file : Path, str
        The file, and its name as the user knows it.
    at : Span
        Where the file is asked for.
    report : Report
        Receives MP001 for what is no file that can be read, MP009 for too large ones.
    most : int
        Bytes that it may have; no more are read.
    """
    report.sought.add(str(path))
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            report.error("MP001", at, f"cannot read {file}: it is no regular file")
            return None  # a pipe would keep us waiting
        with path.open("rb") as stream:
            data = stream.read(most + 1)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        hint = _near(path, file, at.file)
        report.error("MP001", at, f"cannot read {file}: {why}", hint)
        return None
    if len(data) > most:
        report.error("MP009", at, f"{file} is larger than {most} bytes")
        return None
    report.files[str(path)] = hashlib.sha256(data).hexdigest()
    return data


def _near(path: Path, file: str, asking: str) -> str:
    """Return what may be meant as a hint: a file of a similar name, "" if none is.

    It is named as the file that asks would name it: from that one's own folder.

    The file that holds the name is not meant. Where that is the file itself, a
    task is asked for, and the task of a folder is meant.
    """
    try:
        if path == Path(asking) and (path / TASK).is_file():
            return f"did you mean '{path / TASK}'?"
        names = [entry.name for entry in islice(path.parent.iterdir(), MOST_NAMES)]
    except (OSError, ValueError):
        return ""
    others = sorted({*names} - {path.name, Path(asking).name})
    near = difflib.get_close_matches(path.name, others, n=1, cutoff=0.6)
    if not near:
        return ""
    meant, folder = Path(file).parent / near[0], Path(asking).parent
    if file != asking and meant.is_relative_to(folder):
        meant = meant.relative_to(folder)
    return f"did you mean '{meant.as_posix()}'?"


def named_file(
    text: str, at: Span, folder: Path, report: Report
) -> tuple[Path, str] | None:
    """Return the path that a file names and how to call it, or None if it is outside.

    Links count by where they lead. The name is that of the naming file's own folder,
    as the user wrote it, with the reference added.

    Parameters
    ----------
    text, at : str, Span
        The reference, and its position.
    folder : Path
        The folder of the file that holds it.
    report : Report
        Receives MP010.
    """
    inside = False
    try:
        # a path with a root or a drive leaves the folder here
        inside = (folder / text).resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # loops, odd characters
        report.error("MP010", at, f"'{text}' is no usable path: {error}")
        return None
    if text.endswith("/"):  # pathlib drops the slash, and would read a file
        hint = "leave the / at its end out"
        report.error("MP010", at, f"'{text}' names a folder, a file is needed", hint)
        return None
    if not inside or Path(text).is_absolute() or "\\" in text:
        message = f"'{text}' leads out of the folder of {at.file}"
        hint = "keep the file in that folder, name it with / and without .."
        report.error("MP010", at, message, hint)
        return None
    return folder / text, (Path(at.file).parent / text).as_posix()
