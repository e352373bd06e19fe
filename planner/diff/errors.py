"""Why two plans are not compared."""

from __future__ import annotations


class DiffError(Exception):
    """A plan that cannot be compared; carries the code of its finding."""

    def __init__(self, code: str, message: str, file: str) -> None:
        super().__init__(message)
        self.code, self.file = code, file
