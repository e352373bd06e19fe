"""Picture of a shaft that overlaps the material around its hole."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.assembly.fits.peg_in_hole import PegInHole, ring_points
from microplan.planner.assembly.fits.room import Overlap, overlap_of, peg_points
from microplan.planner.assembly.mating import mating_of
from microplan.planner.assembly.step_states import StepState
from microplan.planner.store.pictures import Picture
from microplan.planner.task.task import Task

FOLDER = "fits"
SIDE_PX = 640  # of the drawing; below it stands the legend
LEGEND_PX = 112
FINE = 4  # subpixels a pixel, averaged
SHIFT = 4  # bits of a line's ends below a pixel
MARGIN = 0.12  # of the drawing, around hole and shaft
# Shares of white.
PAPER, MATERIAL, SHAFT, OVERLAP, INK = 255, 214, 150, 40, 0
FONT, TEXT_PX = cv2.FONT_HERSHEY_SIMPLEX, 0.5
BARS = (1.0, 2.0, 5.0)  # lengths of a scale bar, times a power of ten


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawingScale:
    """From the hole's frame to pixels: y up, the middle of a box in the middle."""

    middle_um: tuple[float, float]
    px_per_um: float

    def px(self, points: FloatArray) -> FloatArray:
        """Return columns and rows of points, (N, 2) um to (N, 2) px."""
        x, y = (points - np.array(self.middle_um)).T * self.px_per_um
        return np.column_stack([SIDE_PX / 2 + x, SIDE_PX / 2 - y])


def fit_pictures(task: Task, states: Sequence[StepState]) -> Mapping[str, Picture]:
    """Return a picture of each insertion whose outlines overlap as planned, by path."""
    found = {}
    for state in states:
        if state.step.verb != "insert":
            continue
        mating = mating_of(task, state.step, state.after)
        shape = None if mating is None else mating.shape
        overlap = None if shape is None else overlap_of(shape)
        if shape is not None and overlap is not None:
            title = f"{state.step.onto} in {state.step.target}, as planned"
            path = f"{FOLDER}/{state.step.id}.png"
            found[path] = draw_overlap(shape, overlap, title)
    return found


def draw_overlap(shape: PegInHole, overlap: Overlap, title: str) -> Picture:
    """Return the material around a hole, the shaft, and what they have in common.

    8 bit, with a scale bar, the deepest point marked, and a legend.
    """
    hole, peg = ring_points(shape.hole.rings[0], shape.chord_um), peg_points(shape)
    low = np.minimum(hole.min(axis=0), peg.min(axis=0))
    high = np.maximum(hole.max(axis=0), peg.max(axis=0))
    scale = DrawingScale(
        middle_um=tuple(((low + high) / 2).tolist()),
        px_per_um=SIDE_PX * (1 - 2 * MARGIN) / float((high - low).max()),
    )
    outside = 1 - _inside(scale.px(hole))
    shaft = _inside(scale.px(peg))
    shades = MATERIAL * outside + PAPER * (1 - outside)
    shades = shades * (1 - shaft) + shaft * (OVERLAP * outside + SHAFT * (1 - outside))
    canvas = np.full((SIDE_PX + LEGEND_PX, SIDE_PX), PAPER, dtype=np.uint8)
    canvas[:SIDE_PX] = np.rint(shades).astype(np.uint8)
    for points in (hole, peg):
        line = np.rint(scale.px(points) * 2**SHIFT).astype(np.int32)
        cv2.polylines(
            canvas[:SIDE_PX], [line], isClosed=True, color=INK, thickness=1,
            lineType=cv2.LINE_AA, shift=SHIFT,
        )  # fmt: skip
    _mark(canvas, scale, overlap)
    _legend(canvas, scale, overlap, title)
    return canvas


def _inside(points_px: FloatArray) -> FloatArray:
    """Return the share of each pixel inside a ring, (SIDE_PX, SIDE_PX)."""
    side = SIDE_PX * FINE
    fine = np.zeros((side, side), dtype=np.uint8)
    cv2.fillPoly(fine, [np.rint(points_px * FINE).astype(np.int32)], 1)
    shares = fine.reshape(SIDE_PX, FINE, SIDE_PX, FINE).mean(axis=(1, 3))
    return np.asarray(shares, dtype=np.float64)


def _mark(canvas: Picture, scale: DrawingScale, overlap: Overlap) -> None:
    """Draw a circle around the deepest point, with its depth beside it."""
    (x, y) = scale.px(np.array([overlap.at_um]))[0]
    at = (round(x), round(y))
    cv2.circle(canvas, at, 12, INK, 2, cv2.LINE_AA)
    words = f"{overlap.depth_um:.3g} um deep"
    (wide, _), _ = cv2.getTextSize(words, FONT, TEXT_PX, 1)
    left = min(max(at[0] - wide // 2, 6), SIDE_PX - wide - 6)
    below = at[1] + 32 if at[1] < SIDE_PX / 2 else at[1] - 22
    box = ((left - 4, below - 15), (left + wide + 4, below + 6))
    cv2.rectangle(canvas, *box, PAPER, cv2.FILLED)
    cv2.rectangle(canvas, *box, INK, 1)
    _write(canvas, words, left, below)


def _legend(canvas: Picture, scale: DrawingScale, overlap: Overlap, title: str) -> None:
    """Write what is what below the drawing, with a scale bar."""
    top = SIDE_PX + 26
    cv2.line(canvas, (0, SIDE_PX), (SIDE_PX, SIDE_PX), INK, 1)
    _write(canvas, title, 14, top)
    left = 14
    names = (("around the hole", MATERIAL), ("shaft", SHAFT), ("overlap", OVERLAP))
    for name, shade in names:
        cv2.rectangle(
            canvas, (left, top + 14), (left + 22, top + 30), shade, cv2.FILLED
        )
        cv2.rectangle(canvas, (left, top + 14), (left + 22, top + 30), INK, 1)
        _write(canvas, name, left + 30, top + 28)
        left += 60 + cv2.getTextSize(name, FONT, TEXT_PX, 1)[0][0]
    _write(canvas, f"deepest point {overlap.depth_um:.3g} um", 14, top + 58)
    length_um = _bar_um(SIDE_PX / 4 / scale.px_per_um)
    long = round(length_um * scale.px_per_um)
    right, low = SIDE_PX - 20, top + 46
    cv2.line(canvas, (right - long, low), (right, low), INK, 3)
    words = f"{length_um:g} um"
    wide = cv2.getTextSize(words, FONT, TEXT_PX, 1)[0][0]
    _write(canvas, words, right - (long + wide) // 2, low + 22)


def _bar_um(most_um: float) -> float:
    """Return the longest round length below a limit."""
    power = 10.0 ** math.floor(math.log10(most_um))
    return max(power * bar for bar in BARS if power * bar <= most_um)


def _write(canvas: Picture, words: str, left: int, base: int) -> None:
    """Write a line of text, ASCII only as the font is."""
    plain = words.encode("ascii", "replace").decode()
    cv2.putText(canvas, plain, (left, base), FONT, TEXT_PX, INK, 1, cv2.LINE_AA)
