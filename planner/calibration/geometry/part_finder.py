"""A part looked for all over each picture of a series, by how one of them shows it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.trials.chains import Chain
from microplan.optics.render.scene import Window
from microplan.planner.calibration.readings import PictureReading, PictureReadings
from microplan.planner.measure.measuring import MeasuredPicture, PictureSeries
from microplan.planner.measure.near import NearPlace
from microplan.planner.measure.part_series import found_series
from microplan.planner.measure.part_task import PartCall
from microplan.planner.measure.picture_files import (
    PictureCounts,
    PictureError,
    pages_of,
)
from microplan.planner.measure.picture_region import PictureRegion
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.store.memo import Memo

CODE = "MP904"
_CHAIN: Chain = ("contour_match",)  # asks for edges alone, and is right to 1/100 px
_TRIED = 5  # pictures, those nearest to the middle of the readings first
_AROUND_PX = 6.0  # beyond the part's contour that belong to its looks
_ALIKE = 0.5  # correlation of two pictures of one part, at least


@dataclass(frozen=True, slots=True, kw_only=True)
class PartFinder:
    """How a part looks in one picture of a series, and what measures it in others."""

    series: PictureSeries
    first: MeasuredPicture  # where it was found
    looks: FloatArray  # (rows, columns) counts, the part and a little around it
    corner_px: tuple[int, int]  # column and row of those in the first picture

    def found_in(self, page: PictureCounts) -> MeasuredPicture | PictureError | None:
        """Return where the part is in a picture; None if nothing looks like it.

        Its region may reach beyond the picture, which goes on there as at its rim; the
        part itself may not.
        """
        near = self._near(page.counts)
        if near is None:
            return None
        beyond = _beyond(self.series.look.case.window)
        self.series.near = replace(near, x=near.x + beyond, y=near.y + beyond)
        wide = np.pad(page.counts, beyond, mode="edge")
        found = self.series.found_in(replace(page, counts=wide))
        if isinstance(found, PictureError) or found.column_px is None:
            return found
        row = (found.row_px or 0.0) - beyond
        return replace(found, column_px=found.column_px - beyond, row_px=row)

    def _near(self, counts: FloatArray) -> NearPlace | None:
        """Return where a picture (rows, columns) looks most like the part."""
        scores = cv2.matchTemplate(
            counts.astype(np.float32), self.looks.astype(np.float32),
            cv2.TM_CCOEFF_NORMED,
        )  # fmt: skip
        _, best, _, (column, row) = cv2.minMaxLoc(scores)
        if best < _ALIKE:
            return None
        first = self.first
        return NearPlace(
            x=(first.column_px or 0.0) + column - self.corner_px[0],
            y=(first.row_px or 0.0) + row - self.corner_px[1],
            unit="px",
            theta_rad=first.turn_rad,
        )


def seen_pixels(region: PictureRegion, size: tuple[int, int]) -> BoolArray:
    """Return which pixels of a region that was found lie in its picture.

    Parameters
    ----------
    region : PictureRegion
        As `PartFinder.found_in` has it.
    size : (rows, columns)
        Of the picture, px.

    Returns
    -------
    (R, C) bool array
        False where the picture was continued beyond its rim.
    """
    beyond, window = _beyond(region.case.window), region.case.window
    row = region.rows.start - beyond + np.arange(window.rows)
    column = region.columns.start - beyond + np.arange(window.columns)
    high, wide = (row >= 0) & (row < size[0]), (column >= 0) & (column < size[1])
    inside: BoolArray = high[:, None] & wide
    return inside


def _beyond(window: Window) -> int:
    """Return by how many px pictures are continued beyond their rims."""
    return max(window.rows, window.columns)


def part_finder(
    readings: PictureReadings,
    part: PartCall,
    bits: int | None,
    report: Report,
    memo: Memo,
) -> PartFinder | None:
    """Return what finds a part in all pictures of a table, None if none shows it.

    Parameters
    ----------
    readings : PictureReadings
        Those in the middle are looked at first.
    part : PartCall
        The part; its `near` is where the middle picture shows it.
    bits : int, optional
        Of the pictures.
    report : Report
        Receives what hinders it.
    memo : Memo
        Keeps how the part is measured.

    Raises
    ------
    CallError
        MP902, MP903 if the call leaves open what the part is.
    """
    wide = found_series(part, report, chain=_CHAIN, bits=bits, memo=memo)
    if wide is None:
        return None
    for page in middle_pages(readings):
        found = wide.found_in(page)
        if isinstance(found, MeasuredPicture) and found.is_accepted:
            return _made(page, found, wide, part, bits, report, memo)
    message = "no picture in the middle of the readings shows the part"
    hint = "is it the drawing's, whole and in focus there? --near says where it is"
    report.error(CODE, Span(file=str(readings.file)), message, hint)
    return None


def _in_the_middle(rows: Sequence[PictureReading]) -> list[PictureReading]:
    """Return a few rows whose readings are nearest to the middle of all."""
    values = np.array([[row.x_um, row.y_um, row.z_um] for row in rows])
    middle = (values.min(axis=0) + values.max(axis=0)) / 2
    far = np.linalg.norm(values - middle, axis=1)
    return [rows[k] for k in np.argsort(far, kind="stable")[:_TRIED].tolist()]


def middle_pages(readings: PictureReadings) -> Iterator[PictureCounts]:
    """Yield a few pictures in the middle; what cannot be read is told when all are."""
    for row in _in_the_middle(readings.rows):
        file = readings.file.parent / row.name.partition("[")[0]
        for page in pages_of(file, lambda _rows, _columns: None):
            if isinstance(page, PictureCounts) and page.name == row.name:
                yield page
                break


def _made(
    page: PictureCounts,
    found: MeasuredPicture,
    wide: PictureSeries,
    part: PartCall,
    bits: int | None,
    report: Report,
    memo: Memo,
) -> PartFinder | None:
    """Return a finder by the picture that shows the part."""
    column, row = found.column_px or 0.0, found.row_px or 0.0
    near = NearPlace(x=column, y=row, unit="px", theta_rad=found.turn_rad)
    series: PictureSeries | None = wide
    if part.near is None:  # a look at a small region, that may lie anywhere
        part = replace(part, near=near)
        series = found_series(part, report, chain=_CHAIN, bits=bits, memo=memo)
    if series is None:
        return None
    case = series.look.case
    half_px = case.target.size_um / math.sqrt(2) * case.target.px_per_um + _AROUND_PX
    rows, columns = page.counts.shape
    left, right = _within(column, half_px, columns)
    top, bottom = _within(row, half_px, rows)
    return PartFinder(
        series=series,
        first=found,
        looks=page.counts[top:bottom, left:right],
        corner_px=(left, top),
    )


def _within(middle: float, half: float, size: int) -> tuple[int, int]:
    """Return the pixels of a line of `size` that lie about a place."""
    return max(math.floor(middle - half), 0), min(math.ceil(middle + half) + 1, size)
