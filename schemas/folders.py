"""Regular files of an untrusted folder, up to a size."""

from __future__ import annotations

from pathlib import Path, PurePosixPath


def contents(path: Path, most_bytes: int) -> bytes:
    """Return what a regular file holds; nothing if it is none, or is larger.

    A pipe is no regular file: reading one might wait for ever.
    """
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as stream:
            data = stream.read(most_bytes + 1)
    except (OSError, ValueError):  # ValueError: a name that no file can have
        return b""
    return data if len(data) <= most_bytes else b""


def contents_within(folder: Path, name: str, most_bytes: int) -> bytes:
    """Return what a file holds that a plan names; nothing if it leads out of `folder`.

    Parameters
    ----------
    folder : Path
        The plan's.
    name : str
        Relative to it, with slashes.
    most_bytes : int
        Of the file; a larger one counts as none.
    """
    if name.startswith("/") or ".." in PurePosixPath(name).parts:
        return b""
    return contents(folder / name, most_bytes)
