"""Measurement of one picture: the pose of the target, and its gates."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.templates import Located, located
from microplan.featuresel.routines.chain import measure_chain
from microplan.featuresel.routines.contract import Failure, Measurement
from microplan.planner.measure.near import NearPlace
from microplan.planner.measure.picture_files import (
    CODE,
    PictureCounts,
    PictureError,
    pages_of,
)
from microplan.planner.measure.picture_light import (
    doubtful_light,
    full_scale,
    light,
    no_light,
)
from microplan.planner.measure.picture_look import PictureLook
from microplan.planner.measure.picture_region import (
    PictureRegion,
    region_of,
    turn_rad,
)
from microplan.planner.source.diagnostics import Report, Span
from microplan.schemas.pose import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswerGate:
    """One gate of an answer; lengths in um."""

    name: str  # "score", "spread" or "shift"
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        """Return whether the value meets its limit; a nan does not."""
        if self.name == "score":
            return self.value >= self.limit
        return self.value <= self.limit


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredPicture:
    """What was found in one picture; None where nothing was."""

    name: str
    path: Path
    shown: FloatArray  # the region's light, (rows, columns), 0..1
    region: PictureRegion
    failure: str = ""  # why nothing was found, in words
    x_um: float | None = None  # world
    y_um: float | None = None
    theta_rad: float | None = None  # None: not measured
    turn_rad: float | None = None  # the same, or as it is known
    axis_rad: float | None = None  # the one direction in which the place is known
    column_px: float | None = None  # of the frame
    row_px: float | None = None
    repeatability_um: float | None = None  # the routine's own estimate, one sigma
    gates: tuple[AnswerGate, ...] = ()

    @property
    def is_accepted(self) -> bool:
        """Return whether the target was found and every gate passed."""
        return not self.failure and all(gate.passed for gate in self.gates)

    @property
    def pose(self) -> tuple[float, float, float]:
        """Return x and y, um, and the turn, rad, from nominal; 0 what was not found."""
        case, x_um, y_um = self.region.case, self.x_um, self.y_um
        turn = 0.0 if self.turn_rad is None else self.turn_rad - case.theta_rad
        return (
            0.0 if x_um is None else x_um - case.x_um,
            0.0 if y_um is None else y_um - case.y_um,
            turn,
        )

    @property
    def at_px(self) -> tuple[float, float]:
        """Return column and row in the region's light of where the target was found."""
        case, (x_um, y_um, _) = self.region.case, self.pose
        return case.frame.to_pixel(case.x_um + x_um, case.y_um + y_um)


@dataclass(slots=True, kw_only=True)
class PictureSeries:
    """Pictures of one look, measured in turn; remembers what they had in common."""

    look: PictureLook
    near: NearPlace | None
    bits: int | None
    report: Report  # receives what cannot be used
    colours: bool = False  # a picture in colour was among them
    _seen: dict[bytes, str] = field(default_factory=dict)  # hash of pixels -> name

    def measured(
        self, files: Sequence[Path | PictureError]
    ) -> Iterator[MeasuredPicture]:
        """Yield what is found in each picture of files; unusable ones are reported."""
        for file in files:
            if isinstance(file, PictureError):
                report_unusable(file, self.report)
                continue
            for page in pages_of(file, self.other_size):
                found = page if isinstance(page, PictureError) else self.found_in(page)
                if isinstance(found, PictureError):
                    report_unusable(found, self.report)
                else:
                    yield found

    def other_size(self, rows: int, columns: int) -> tuple[str, str] | None:
        """Return why a picture of a size has no region, None if it has one."""
        found = region_of(self.look.case, (rows, columns), self.near)
        return None if isinstance(found, PictureRegion) else found

    def found_in(self, page: PictureCounts) -> MeasuredPicture | PictureError:
        """Return what is in a picture, or why it cannot be used."""
        rows, columns = page.counts.shape
        region = region_of(self.look.case, (rows, columns), self.near)
        if not isinstance(region, PictureRegion):
            return PictureError(page.path, f"{page.name}: {region[0]}", region[1])
        sensor = self.look.case.sensor
        full = full_scale(
            float(page.counts.max()), page.file_bits, sensor.bits, self.bits
        )
        part = region.cut(page.counts)
        if (wrong := no_light(page.counts, part, full)) is not None:
            return PictureError(page.path, f"{page.name}: {wrong[0]}", wrong[1])
        self.colours |= page.is_colour
        self._warn(page, part, full)
        shown = light(part, full, sensor)
        return measure_region(self.look, region, shown, page.name, page.path)

    def _warn(self, page: PictureCounts, part: FloatArray, full: int) -> None:
        """Report what makes a picture doubtful, although it is measured."""
        where = Span(file=str(page.path))
        if (doubt := doubtful_light(part, full)) is not None:
            self.report.warning(CODE, where, f"{page.name}: {doubt[0]}", doubt[1])
        size = np.array(page.counts.shape).tobytes()
        key = hashlib.sha256(size + page.counts.tobytes()).digest()
        first = self._seen.get(key)
        self._seen.setdefault(key, page.name)
        if first is not None:
            message = f"{page.name} has exactly the pixels of {first}"
            hint = "take another picture: a copy says nothing of how answers repeat"
            self.report.warning(CODE, where, message, hint)


def report_unusable(found: PictureError, report: Report) -> None:
    """Add to the findings why a picture cannot be used."""
    report.error(found.code, Span(file=found.file), str(found), found.hint)


def measure_region(
    look: PictureLook, region: PictureRegion, shown: FloatArray, name: str, path: Path
) -> MeasuredPicture:
    """Return what a look's chain finds in a region.

    `shown` is its light, (rows, columns), 0..1 of full scale. The mean error of the
    trials, fixed in the target's frame, is taken off where the angle is known.
    """
    found = measure_chain(shown, look.stages, region.guess)
    if isinstance(found, Failure):
        return MeasuredPicture(
            name=name, path=path, shown=shown, region=region, failure=found.message
        )
    place = located(region.case, found)
    if isinstance(place, Failure):
        return MeasuredPicture(
            name=name, path=path, shown=shown, region=region, failure=place.message
        )
    turn = turn_rad(region.case, region.guess, place.theta_rad)
    x_um, y_um = _unbiased(look, place, turn)
    column, row = replace(region.case.frame, row=0, column=0).to_pixel(x_um, y_um)
    return MeasuredPicture(
        name=name,
        path=path,
        shown=shown,
        region=region,
        x_um=x_um,
        y_um=y_um,
        theta_rad=place.theta_rad,
        turn_rad=turn,
        axis_rad=place.axis_rad,
        column_px=column,
        row_px=row,
        repeatability_um=found.spread_px * region.case.microscope.um_per_px,
        gates=_gates(look, region, found, (x_um, y_um)),
    )


def _unbiased(
    look: PictureLook, place: Located, turn: float | None
) -> tuple[float, float]:
    """Return a place, um, less the mean error that trials showed."""
    if turn is None:
        return (place.x_um, place.y_um)
    bias_um = Pose(x_um=0.0, y_um=0.0, theta_rad=turn).apply(*look.bias_um)
    return (place.x_um - bias_um[0], place.y_um - bias_um[1])


def _gates(
    look: PictureLook,
    region: PictureRegion,
    found: Measurement,
    at_um: tuple[float, float],
) -> tuple[AnswerGate, ...]:
    """Return the gates of an answer at a place in the world."""
    limits = look.gates
    spread_um = found.spread_px * region.case.microscope.um_per_px
    shift_um = math.dist(at_um, region.expected_um)
    most_um = math.inf if limits.max_spread_um is None else limits.max_spread_um
    return (
        AnswerGate(name="score", value=found.score, limit=limits.min_score),
        AnswerGate(name="spread", value=spread_um, limit=most_um),
        AnswerGate(name="shift", value=shift_um, limit=limits.max_shift_um),
    )
