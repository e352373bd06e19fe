"""The part of a picture in which the target is looked for, and where."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Guess
from microplan.featuresel.trials.trials import start
from microplan.optics.render.scene import Window
from microplan.planner.measure.near import NearPlace

Size = tuple[int, int]  # rows, columns


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureRegion:
    """The region of a picture."""

    case: LookCase  # of the look, its window and frame as they lie in the picture
    rows: slice
    columns: slice
    guess: Guess  # px of the region

    @property
    def expected_um(self) -> tuple[float, float]:
        """Return where the target is expected, world."""
        return self.case.frame.to_world(self.guess.column, self.guess.row)

    def cut(self, image: FloatArray) -> FloatArray:
        """Return the region, (R, C), of a picture (rows, columns) in its own unit."""
        return image[self.rows, self.columns]


def region_of(
    case: LookCase, size: Size, near: NearPlace | None
) -> PictureRegion | tuple[str, str]:
    """Return the region of a picture of `size`, or why there is none and what to take.

    A picture of the camera's size shows the frame, one of the look's region that
    region of it. With `near` in px it may have any other size that holds the region;
    positions in um are then from its middle.
    """
    whole, window = _sizes(case)
    if size not in (whole, window):
        if near is None or near.unit != "px" or not _holds(size, window):
            return _other_size(size, whole, window)
        scope = replace(case.microscope, width_px=size[1], height_px=size[0])
        case = replace(case, microscope=scope)
    is_cut = size == window != whole
    place, off_px = _moved(case, near)
    room = Window(row=0, column=0, rows=size[0], columns=size[1])
    if is_cut:
        room = case.window
    if not _inside(place, room):
        return _too_near(case, is_cut=is_cut)
    by = (room.row, room.column) if is_cut else (0, 0)
    k = case.target.px_per_um
    return PictureRegion(
        case=replace(case, window=place),
        rows=slice(place.row - by[0], place.row - by[0] + place.rows),
        columns=slice(place.column - by[1], place.column - by[1] + place.columns),
        guess=_turned(case, start(case, (off_px[0] / k, -off_px[1] / k)), near),
    )


def _sizes(case: LookCase) -> tuple[Size, Size]:
    """Return the camera's size and the region's."""
    scope, window = case.microscope, case.window
    return (scope.height_px, scope.width_px), (window.rows, window.columns)


def _moved(
    case: LookCase, near: NearPlace | None
) -> tuple[Window, tuple[float, float]]:
    """Return the window moved by whole pixels, and what is left of the way, px."""
    window = case.window
    if near is None:
        return window, (0.0, 0.0)
    column, row = near.x, near.y
    if near.unit == "um":
        column, row = replace(case.frame, row=0, column=0).to_pixel(near.x, near.y)
    left, top = column - case.target.column, row - case.target.row
    moved = replace(window, column=round(left), row=round(top))
    return moved, (left - moved.column, top - moved.row)


def _turned(case: LookCase, guess: Guess, near: NearPlace | None) -> Guess:
    """Return the start with the angle that is stated, if one is."""
    if near is None or near.theta_rad is None:
        return guess
    own_rad = case.target.theta_rad - case.theta_rad
    return replace(guess, theta_rad=near.theta_rad + own_rad)


def _inside(window: Window, room: Window) -> bool:
    """Return whether a window lies inside another."""
    down, right = window.row - room.row, window.column - room.column
    return (
        0 <= down <= room.rows - window.rows
        and 0 <= right <= room.columns - window.columns
    )


def _holds(size: Size, window: Size) -> bool:
    return size[0] >= window[0] and size[1] >= window[1]


def _too_near(case: LookCase, *, is_cut: bool) -> tuple[str, str]:
    """Return that a region would leave the picture, and where the target may be."""
    window, target = case.window, case.target
    size = f"{window.columns} x {window.rows} px"
    if is_cut:
        column, row = window.column + target.column, window.row + target.row
        why = f"it is the look's region of {size} and cannot be moved"
        return why, (
            f"in it the target is at {column:.0f}px,{row:.0f}px of the frame; take the "
            "whole frame for another place"
        )
    right, low = window.columns - 1 - target.column, window.rows - 1 - target.row
    why = f"the region of {size} about the place of --near would leave the picture"
    return why, (
        f"the target must be {target.column:.0f} px or more from the left rim, "
        f"{right:.0f} from the right, {target.row:.0f} from the upper, {low:.0f} from "
        "the lower one"
    )


def _other_size(size: Size, whole: Size, window: Size) -> tuple[str, str]:
    """Return that a size is not taken, and which are."""
    (w, h), (a, b) = whole[::-1], window[::-1]
    return f"it is {size[1]} x {size[0]} px", (
        f"taken are {w} x {h}, the camera's frame, and {a} x {b}, the look's region; "
        "with --near in px all that hold the region"
    )


def turn_rad(case: LookCase, guess: Guess, found_rad: float | None) -> float | None:
    """Return the target's angle in the world as found, else as known; None if not."""
    if found_rad is not None:
        return found_rad
    if guess.theta_rad is None:
        return None
    return math.remainder(
        guess.theta_rad - case.target.theta_rad + case.theta_rad, math.tau
    )
