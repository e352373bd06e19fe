"""Exports written atomically: whole or not at all, over nothing unasked."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path

from microplan.planner.store.folder import OutputError, replace_by, replace_bytes

INDEX = "export.json"  # by which a folder is known to be an export
_STRANGE = re.compile(r"[^A-Za-z0-9_-]")
_MOST_NAME = 80  # characters: file systems allow 255, and a suffix comes after them


def check_free(out: Path, *, folder: bool, overwrite: bool) -> None:
    """Raise unless an export may be put at `out`.

    Raises
    ------
    OutputError
        MP702 if a folder is where a file should be, or the other way round; MP703 if
        there is something already: of an older export only if `overwrite` is False.
    """
    if not os.path.lexists(out):
        return
    if out.is_dir() != folder:
        kind = "a folder" if out.is_dir() else "no folder"
        raise OutputError("MP702", f"{out} is {kind}", out)
    if folder and not any(out.iterdir()):
        return
    if folder and not (out / INDEX).is_file():
        raise OutputError(
            "MP703",
            f"{out} holds other things than an export; it is left untouched",
            out,
        )
    if not folder and not out.is_file():
        raise OutputError("MP702", f"{out} is no regular file", out)
    if not overwrite:
        message = f"{out} is there already; --overwrite replaces it"
        raise OutputError("MP703", message, out)


def write_file(out: Path, data: bytes, *, overwrite: bool) -> None:
    """Write a file; errors as `check_free`, MP702 if it cannot be written."""
    check_free(out, folder=False, overwrite=overwrite)
    replace_bytes(out, data)


def write_folder(
    out: Path, files: Mapping[str, bytes], index: object, *, overwrite: bool
) -> None:
    """Write a folder of files and their index; errors as `write_file`.

    An older export is replaced whole.
    """
    check_free(out, folder=True, overwrite=overwrite)
    text = json.dumps(index, indent=2, ensure_ascii=False) + "\n"
    held = {**files, INDEX: text.encode("utf-8", "backslashreplace")}

    def fill(fresh: Path) -> None:
        for name, data in held.items():
            (fresh / name).write_bytes(data)

    replace_by(out, fill)


def file_names(ids: list[str], suffix: str) -> list[str]:
    """Return a file name for each id, all different on every file system.

    Characters other than letters, digits, `_` and `-` become `_`.
    """
    found: list[str] = []
    for name in ids:
        stem = _STRANGE.sub("_", name)[:_MOST_NAME] or "_"
        fresh, more = stem, 1
        while f"{fresh}{suffix}".lower() in map(str.lower, found):
            more += 1
            fresh = f"{stem}.{more}"
        found.append(f"{fresh}{suffix}")
    return found
