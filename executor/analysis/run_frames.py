"""Frames of a run for its report: the first and the last of every step, made small."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from microplan.executor.analysis.run_artifacts import Row, RunArtifacts, real, text
from microplan.executor.record.frames import FOLDER, png_bytes, read_png
from microplan.schemas.page.elements import Element, el
from microplan.schemas.page.figures import um
from microplan.schemas.page.page import Caption, figure, png_size, png_uri

_MOST_PX = 320  # of the longer side of a frame in the page
_CAPTION = Caption(
    title="First and last frame of each step",
    shows="What the camera gave first and last in every step that kept a frame, made "
    "smaller, with the height in focus; what lies higher or lower is blurred, so that "
    "a verification sees part and seat in turn.",
    judge="Good: the last frame of a step looks like the plan's image of it; bad: "
    "parts "
    "are missing, turned or blurred.",
    do=f"For more, look into {FOLDER}/: the frames there are lossless, and all of "
    f"them.",
)
_MOST_STEPS = 60  # a page with more would not be read


def frame_figures(left: RunArtifacts) -> Iterator[Element]:
    """Yield the first and last whole frame of every step that kept some."""
    whole = [row for row in left.frames if row.get("shows") is None]
    steps = list(dict.fromkeys(text(row, "step") for row in whole))
    tiles = []
    for step in steps[:_MOST_STEPS]:
        rows = [row for row in whole if text(row, "step") == step]
        ends = [(rows[0], "first frame"), (rows[-1], "last frame")]
        for row, words in ends if len(rows) > 1 else [(rows[0], "only frame")]:
            focus_um = real(row, "focus_um")
            at = "" if focus_um is None else f", focus {um(focus_um)}"
            tiles.append(_tile(left.folder, row, f"{step}, {words}", at))
    found = [tile for tile in tiles if tile is not None]
    if found:
        yield figure(_CAPTION, el("div", found, class_="strip wide-tiles"))


def _tile(folder: Path, row: Row, words: str, more: str) -> Element | None:
    """Return one frame made small, None if it cannot be read."""
    name = text(row, "file")
    parts = PurePosixPath(name).parts
    if len(parts) != 2 or parts[0] != FOLDER or ".." in parts:
        return None
    try:
        data = png_bytes(small(read_png(folder / name)))
    except (OSError, ValueError):  # ValueError: a name that no file can have
        return None
    width, height = png_size(data)
    picture = el("img", src=png_uri(data), alt=f"Frame of {words}", width=width,
                 height=height)  # fmt: skip
    return el("div", picture, el("p", words, more))


def small(counts: Any) -> Any:
    """Return a frame as 8 bit, averaged over squares until it is small enough."""
    most = 255 if counts.dtype == np.uint8 else max(int(counts.max()), 1)
    step = -(-max(counts.shape) // _MOST_PX)
    down, across = (min(step, side) for side in counts.shape)
    rows, columns = counts.shape[0] // down, counts.shape[1] // across
    cut = counts[: rows * down, : columns * across]
    mean = cut.reshape(rows, down, columns, across).mean(axis=(1, 3)) * (255 / most)
    return np.clip(np.rint(mean), 0, 255).astype(np.uint8)
