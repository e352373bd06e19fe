"""The frames of a run: every one that was used, lossless, with an index."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from microplan.executor.devices.drivers import Counts
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.record.write_ahead_log import ESCAPED
from microplan.schemas.plan import Region

FOLDER = "frames"
INDEX = "index.jsonl"
_PNG_LEVEL = 1  # of zlib: a noisy frame gets little smaller by more


class Frames:
    """Keeps frames under a folder of the run; None keeps nothing.

    Parameters
    ----------
    folder : Path or None
        The run folder; the frames go to `FOLDER` in it.
    wanted : bool, optional
        Whether the run is to take the frames that only a record needs; by default
        where there is a folder. A replay takes them and keeps none.
    tag : str, optional
        At the end of every file's name, so that the executor which resumes a run
        overwrites no frame of the one before.

    Raises
    ------
    ExecutorError
        MP863 if the folder cannot be made.
    """

    def __init__(
        self, folder: Path | None, *, wanted: bool | None = None, tag: str = ""
    ) -> None:
        self._folder, self._tag = folder, tag
        # whether whole frames are to be taken for the record
        self.wanted = folder is not None if wanted is None else wanted
        self.last: str | None = None  # path of the last frame, None if it was not kept
        self._name, self._step, self._count = "", "", 0
        self._look: tuple[str, Region | None] = ("", None)
        if folder is not None:
            try:
                (folder / FOLDER).mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise ExecutorError("MP863", f"{FOLDER}: {error}") from error

    def enter(self, number: int, step: str) -> None:
        """Begin a step; its number keeps the files in order."""
        self._name, self._step, self._count = f"{number:02d}_{step}", step, 0

    def leave(self) -> None:
        """End the last step."""
        self._name, self._step = "", ""

    def expect(self, look: str, measured: Region | None) -> None:
        """Note which look the next frame is for, and which region of it is measured."""
        self._look = (look, measured)

    def save(
        self, counts: object, shown: Region | None, facts: Mapping[str, Any]
    ) -> str | None:
        """Keep a frame as it came from the camera, and a line on it in the index.

        Parameters
        ----------
        counts : object
            What the camera gave: (rows, columns) uint8 or uint16 if it is a frame.
        shown : Region or None
            The part of the camera's frame that it is; None: the whole.
        facts : mapping
            More for the index: readings, view, exposure.

        Returns
        -------
        str or None
            Its path in the run folder; None if it is no frame or nothing is kept.

        Raises
        ------
        ExecutorError
            MP863 if it cannot be written.
        """
        self.last = None
        if self._folder is None or not is_frame(counts):
            return None
        self._count += 1
        part = self._tag if shown is None else f"{self._tag}_region"
        path = f"{FOLDER}/{self._name}_{self._count:03d}{part}.png"
        look, measured = self._look
        line = {
            "file": path, "step": self._step, "look": look,
            "shows": region_data(shown), "measured": region_data(measured), **facts,
        }  # fmt: skip
        try:
            write_png(self._folder / path, counts)
            path_ = self._folder / FOLDER / INDEX
            with path_.open("a", encoding="utf-8", errors=ESCAPED) as index:
                index.write(json.dumps(line, ensure_ascii=False) + "\n")
        except OSError as error:
            raise ExecutorError("MP863", f"{path}: {error}") from error
        self.last = path
        return path


def is_frame(counts: object) -> bool:
    """Return whether something is a picture that a PNG file can hold."""
    return (
        isinstance(counts, np.ndarray)
        and counts.dtype in (np.uint8, np.uint16)
        and counts.ndim == 2
        and counts.size > 0
    )


def region_data(region: Region | None) -> list[int] | None:
    """Return row, column, rows and columns, None for the whole frame."""
    if region is None:
        return None
    return [region.row, region.column, region.rows, region.columns]


def write_png(path: Path, counts: Any) -> None:
    """Write counts at their own depth; OSError if that does not work."""
    path.write_bytes(png_bytes(counts))


def png_bytes(counts: Any) -> bytes:
    """Return counts as a PNG file at their own depth; OSError if there is none."""
    import cv2  # heavy, and only a run that keeps frames needs it

    plain = np.ascontiguousarray(counts)
    done, data = cv2.imencode(".png", plain, [cv2.IMWRITE_PNG_COMPRESSION, _PNG_LEVEL])
    if not done:
        raise OSError("it cannot be encoded")
    found: bytes = data.tobytes()
    return found


def read_png(path: Path) -> Counts:
    """Return counts at their own depth; OSError if the file is missing or damaged."""
    import cv2  # as above

    data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    try:
        counts: Any = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error as error:  # a head with more than OpenCV takes
        raise OSError(f"it cannot be read: {error.err}") from error
    if not is_frame(counts):
        raise OSError("it is no grey picture")
    found: Counts = counts
    return found
