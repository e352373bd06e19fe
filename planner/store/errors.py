"""Why nothing was written."""

from __future__ import annotations

import os


class OutputError(Exception):
    """The output cannot be written; the message says why, `code` is MP7xx."""

    def __init__(self, code: str, message: str, file: str | os.PathLike[str]) -> None:
        super().__init__(message)
        self.code, self.file = code, os.fspath(file)  # where it was to be written


def not_written(
    file: str | os.PathLike[str], error: OSError | ValueError
) -> OutputError:
    """Return MP702 for an error on the way: files that the user never named stay out.

    An OSError's own words hold the path that failed, which may be of a file that is
    put into place only when it is whole.
    """
    why = error.strerror if isinstance(error, OSError) else ""
    path = os.fspath(file)
    return OutputError("MP702", f"{path} cannot be written: {why or error}", path)
