"""What a path leads to; one that cannot be looked at leads nowhere.

A name that is too long, a loop of links and a folder without permission raise in
`pathlib`. Whoever then opens the path tells what is wrong with it.
"""

from __future__ import annotations

from pathlib import Path


def is_file(path: Path) -> bool:
    """Return whether a path leads to a file."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_folder(path: Path) -> bool:
    """Return whether a path leads to a folder."""
    try:
        return path.is_dir()
    except OSError:
        return False


def stays_in(path: Path, folder: Path) -> bool:
    """Return whether a path leads to a place in a folder, links followed."""
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):  # NUL in a name; a loop of links
        return False
