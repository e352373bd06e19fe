"""Why nothing was written."""

from __future__ import annotations


class OutputError(Exception):
    """The folder cannot be written; the message says why, `code` is MP7xx."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code
