"""The first and last frame of every step, kept as PNG files."""

from __future__ import annotations

from pathlib import Path

from executor.drivers import Counts
from executor.errors import ExecutorError


class Frames:
    """Keeps frames under a folder; None keeps nothing."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._name = ""
        self._last: Counts | None = None
        self._any = False
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    @property
    def wanted(self) -> bool:
        """Return whether frames are kept at all."""
        return self._folder is not None

    def enter(self, number: int, step: str) -> None:
        """Begin a step; its number keeps the files in order."""
        self.leave()
        self._name = f"{number:02d}_{step}"

    def keep(self, counts: Counts) -> None:
        """Keep a frame: as the step's first, else as its last so far."""
        if self._folder is None:
            return
        if not self._any:
            self._write("first", counts)
        self._any, self._last = True, counts

    def leave(self) -> None:
        """End the step and write its last frame."""
        if self._last is not None:
            self._write("last", self._last)
        self._last, self._any = None, False

    @property
    def empty(self) -> bool:
        """Return whether the step has no frame yet."""
        return not self._any

    def _write(self, which: str, counts: Counts) -> None:
        import cv2  # heavy, and only a run that keeps frames needs it

        if self._folder is None:
            return
        path = self._folder / f"{self._name}_{which}.png"
        if not cv2.imwrite(str(path), counts):
            raise ExecutorError("MP804", f"{path} cannot be written")
