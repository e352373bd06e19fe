"""Reference images of two plans, compared by pixel."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from microplan.planner.diff.changes import PlanChange
from microplan.schemas.folders import contents_within
from microplan.schemas.page.page import png_size
from microplan.schemas.plan import Plan

Picture = npt.NDArray[np.uint8]
LEVELS = 1  # of 255: rounding may fall to either side
MOST_BYTES = 1 << 26  # of a picture's file
_MOST_PX = 1 << 26  # of a picture: an 8192 x 8192 sensor


def compare_pictures(
    old: Plan, old_folder: Path, new: Plan, new_folder: Path, levels: int = LEVELS
) -> Iterator[PlanChange]:
    """Yield the looks whose images differ by more than `levels` of 255 anywhere.

    Looks that only one plan has, and images that neither folder has, are passed over.
    """
    before, after = _images(old), _images(new)
    for look in before:
        if look not in after:
            continue
        ends = _read(old_folder, before[look]), _read(new_folder, after[look])
        says = _difference(*ends, levels)
        if says:
            step, name = look
            path = ("steps", step, "looks", name, "scene", "image")
            yield PlanChange(
                path=path, kind="picture", old=before[look], new=after[look], says=says
            )


def _images(plan: Plan) -> dict[tuple[str, str], str]:
    """Return every look's image, by step and look."""
    return {
        (step.id, look.id): look.scene.image
        for step in plan.steps
        for look in step.looks
        if look.scene.image
    }


def _read(folder: Path, name: str) -> Picture | None:
    """Return a picture's pixels, None if there is no readable one."""
    return decoded(contents_within(folder, name, MOST_BYTES))


def decoded(data: bytes) -> Picture | None:
    """Return the pixels of a PNG file, None if it is none or too large to unpack."""
    try:
        width, height = png_size(data)
    except ValueError:
        return None
    if not 0 < width * height <= _MOST_PX:
        return None
    found: Any = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return None if found is None else found


def _difference(old: Picture | None, new: Picture | None, levels: int) -> str:
    """Return how two pictures differ, "" if they do not."""
    if old is None and new is None:
        return ""
    if old is None or new is None:
        return "no picture in the " + ("old" if old is None else "new") + " folder"
    if old.shape != new.shape:
        size = [f"{p.shape[1]} x {p.shape[0]}" for p in (old, new)]
        return f"{size[0]} pixels became {size[1]}"
    away = np.abs(old.astype(np.int32) - new.astype(np.int32))
    beyond = away > levels
    if not beyond.any():
        return ""
    rms = float(np.sqrt(np.mean(np.square(away, dtype=np.float64))))
    row, column = np.argwhere(beyond)[0][:2]
    return (
        f"{int(beyond.sum())} of {away.size} pixels differ by more than {levels} of "
        f"255, at most by {int(away.max())}, rms {rms:.3g}; the first at row {row}, "
        f"column {column}"
    )
