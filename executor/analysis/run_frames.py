"""Frames of a run as small tiles of its report, with the steps' times."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from microplan.executor.analysis.run_summaries import Row, RunArtifacts, real, text
from microplan.executor.record.frames import FOLDER, png_bytes, read_png
from microplan.schemas.files.times import JAWS, PROBE
from microplan.schemas.page.elements import Element, el
from microplan.schemas.page.figures import number, seconds, um
from microplan.schemas.page.page import Caption, figure, png_size, png_uri


def predicted(left: RunArtifacts) -> Element | None:
    """Return the time of the predicted steps, with a list of the others."""
    known = [
        (took, expected)
        for step in left.steps
        if (took := real(step, "time_s")) is not None
        and (expected := real(step, "expected_s")) is not None
    ]
    if not known:
        return None
    took, expected = (sum(column) for column in zip(*known, strict=True))
    rest: dict[str, list[str]] = {}
    for step in left.steps:
        if real(step, "expected_s") is None:
            rest.setdefault(_unpredicted(left, step), []).append(str(step["id"]))
    others = "; ".join(
        ", ".join(names) + (f" ({why})" if why else "") for why, names in rest.items()
    )
    said = f"{seconds(took)} of it predicted as {seconds(expected)}"
    return el("small", f"{said}; not predicted: {others}" if others else said)


def times(left: RunArtifacts, step: Row) -> str:
    """Return the measured and the expected time of a step, or why there is none."""
    expected = real(step, "expected_s")
    if expected is not None:
        said = seconds(expected)
    else:
        why = _unpredicted(left, step)
        said = f"not predicted ({why})" if why else "not predicted"
    return pair(seconds(real(step, "time_s")), said)


def pair(actual: str, predicted: str) -> str:
    """Return "actual / predicted", one dash if there is neither."""
    nothing = number(None)
    if actual == nothing and predicted == nothing:
        return nothing
    return f"{actual} / {predicted}"


def _unpredicted(left: RunArtifacts, step: Row) -> str:
    """Return why a step's time is not predicted, "" if that is unknown."""
    if text(step, "verb") in ("grasp", "release"):
        return JAWS
    name = str(step["id"])
    events = (row for row in left.events if row.get("step") == name)
    probed = any(text(row, "event").startswith("probe") for row in events)
    return PROBE if probed else ""


_MOST_PX = 320  # of the longer side of a frame in the page
_CAPTION = Caption(
    title="First and last frame of each step",
    shows="What the camera gave first and last in every step that kept a frame, made "
    "smaller, with the height in focus; what lies higher or lower is blurred, so that "
    "a verification sees part and seat in turn.",
    judge="Good: the last frame of a step looks like the plan's image of it; bad: "
    "parts are missing, turned or blurred.",
    do=f"For more, look into {FOLDER}/: the frames there are lossless, and all "
    "of them.",
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
