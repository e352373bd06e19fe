"""A known part found in each picture of a series: where it is, how large it looks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.planner.calibration.discrepancy.place_misfits import PlaceMisfits
from microplan.planner.calibration.geometry.drawn_edges import (
    TRUE_PX,
    DrawnScale,
    drawn_scale,
    lone_points,
)
from microplan.planner.calibration.geometry.face_images import face_images
from microplan.planner.calibration.geometry.light_field import (
    PlacedGain,
    part_gain,
)
from microplan.planner.calibration.geometry.part_finder import PartFinder, seen_pixels
from microplan.planner.calibration.geometry.stage_stop import StageStop
from microplan.planner.calibration.picture_intake import CODE, PictureIntake
from microplan.planner.calibration.readings import (
    PictureReading,
    PictureReadings,
    readings_of_pages,
)
from microplan.planner.measure.measuring import MeasuredPicture
from microplan.planner.measure.picture_files import PictureCounts, PictureError
from microplan.planner.source.diagnostics import Span

_CUT = 0.001  # share of pixels at the highest value that means something cut off


@dataclass(frozen=True, slots=True, kw_only=True)
class PartPlace:
    """A part in one picture."""

    reading: PictureReading
    right_px: float  # from the middle of the picture
    up_px: float
    drawn: DrawnScale | None
    light: PlacedGain | None = None

    @property
    def tells_scale(self) -> bool:
        """Return whether its edges tell the drawing's scale, apart from an offset."""
        return self.drawn is not None and self.drawn.offset_apart


@dataclass(slots=True, kw_only=True)
class PartPlaces:
    """Places of a part as pictures are read; those without it are reported."""

    finder: PartFinder
    intake: PictureIntake
    misfits: PlaceMisfits = field(default_factory=PlaceMisfits)
    found: list[PartPlace] = field(default_factory=list)
    corner_px: float = 0.0  # from the middle of a picture to its corner
    _lone: BoolArray | None = None

    def read(self, readings: PictureReadings) -> None:
        """Find the part in the pictures of a table."""
        for row, page in readings_of_pages(readings, self.intake):
            measured = self.finder.found_in(page)
            why = _refusal(measured)
            if why or not isinstance(measured, MeasuredPicture):
                self._refuse(page, why)
                continue
            rows, columns = page.counts.shape
            self.corner_px = math.hypot(rows, columns) / 2
            self.found.append(self._place(row, measured, (rows, columns)))

    def _refuse(self, page: PictureCounts, why: str) -> None:
        """Report a picture that does not show the part."""
        message = f"{page.name} does not show the part: {why}"
        hint = "is it the drawing's, whole in the field and in focus?"
        where = Span(file=str(page.path))
        self.intake.report.warning(CODE, where, message, hint)

    def _place(
        self, row: PictureReading, measured: MeasuredPicture, size: tuple[int, int]
    ) -> PartPlace:
        """Return where a part is in a picture of (rows, columns)."""
        column, line = measured.column_px or 0.0, measured.row_px or 0.0
        right, up = column - (size[1] - 1) / 2, (size[0] - 1) / 2 - line
        drawn, seen = self._drawn(row, measured, size)
        light = None
        if seen is not None:
            across, high = right / size[1], up / size[0]
            level, gain, *faces = seen.tolist()
            light = PlacedGain(
                right=across, up=high, gain=gain, level=level, faces=tuple(faces)
            )
        return PartPlace(
            reading=row, right_px=right, up_px=up, drawn=drawn, light=light
        )

    def _drawn(
        self, row: PictureReading, measured: MeasuredPicture, size: tuple[int, int]
    ) -> tuple[DrawnScale | None, FloatArray | None]:
        """Return how large the part looks and how bright, None if it is not told.

        Its misfit is kept.
        """
        case = measured.region.case
        if self._lone is None:
            self._lone = lone_points(case)
        if measured.x_um is None or measured.y_um is None:
            return None, None
        x_um, y_um, turn = measured.pose
        meant = nominal_render(case)(dx_um=x_um, dy_um=y_um, theta_rad=turn)
        theta = case.target.theta_rad + turn
        place = row.x_um, row.y_um, row.group
        used = seen_pixels(measured.region, size) & ~_cut_off(measured.shown)
        self.misfits.add(place, case, measured.shown, meant, measured.at_px, used)
        drawn = drawn_scale(
            case, measured.shown, meant, measured.at_px, theta, self._lone
        )
        faces = meant[None]
        if len(case.moving) > 1:
            faces = face_images(case, x_um, y_um, turn)
        return drawn, part_gain(measured.shown, faces, measured.at_px, used)


def _cut_off(shown: FloatArray) -> BoolArray:
    """Return the pixels of a picture (rows, columns) where light is cut off, 0..1.

    They share its highest value, which else a few pixels have.
    """
    highest: BoolArray = shown >= shown.max()
    return highest if highest.mean() > _CUT else np.zeros_like(highest)


def _refusal(measured: MeasuredPicture | PictureError | None) -> str:
    """Return why an answer is none, "" if it is one."""
    if measured is None:
        return "nothing in it looks as it does in others"
    if isinstance(measured, PictureError):
        return str(measured)
    if measured.failure or measured.is_accepted:
        return measured.failure
    failed = [gate.name for gate in measured.gates if not gate.passed]
    return f"its {' and '.join(failed)} did not pass"


def stops_of(places: Sequence[PartPlace]) -> list[StageStop]:
    """Return successive places of one stage reading as a stop each.

    With the drawing's scale if most places tell it; of those alone.
    """
    return list(_stops(places, drawn=tell_scale(places)))


def gains_of(places: Sequence[PartPlace]) -> list[list[PlacedGain]]:
    """Return how bright the part is at each place, its pictures together."""
    held: dict[tuple[float, float, str], list[PlacedGain]] = {}
    for place in places:
        if place.light is not None:
            read = place.reading
            held.setdefault((read.x_um, read.y_um, read.group), []).append(place.light)
    return list(held.values())


def tell_scale(places: Sequence[PartPlace]) -> bool:
    """Return whether most places tell the drawing's scale."""
    return 2 * sum(place.tells_scale for place in places) > len(places)


def _stops(places: Sequence[PartPlace], *, drawn: bool) -> Iterator[StageStop]:
    def key(place: PartPlace) -> tuple[float, float, str]:
        return (place.reading.x_um, place.reading.y_um, place.reading.group)

    for (x_um, y_um, _), group in groupby(places, key):
        held = list(group)
        seen = np.array([[place.right_px, place.up_px] for place in held])
        right, up = seen.mean(axis=0).tolist()
        squares = np.sum((seen - seen.mean(axis=0)) ** 2, axis=0).tolist()
        told = [p.drawn for p in held if drawn and p.drawn and p.tells_scale]
        stop = StageStop(
            x_um=x_um,
            y_um=y_um,
            right_px=right,
            up_px=up,
            pictures=len(held),
            scatter_px=(squares[0], squares[1]),
        )
        yield _with_scale(stop, told) if told else stop


def _with_scale(stop: StageStop, told: Sequence[DrawnScale]) -> StageStop:
    """Return a stop with the drawing's scale in its pictures."""
    return replace(
        stop,
        stretch=np.mean([each.stretch for each in told], axis=0),
        offset_px=float(np.mean([each.offset_px for each in told])),
        true_share=TRUE_PX / told[0].reach_px,
        true_px=TRUE_PX,
    )
