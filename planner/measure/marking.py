"""Pictures with the target's drawn contour at the pose that was found."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contour.polarity import place
from microplan.planner.measure.measuring import MeasuredPicture
from microplan.planner.store.folder import OutputError, not_written, replace_alike
from microplan.planner.store.pictures import picture

LEAST_PX = 400  # width of a marked picture
_ACCEPTED, _REFUSED = (0, 200, 0), (0, 0, 255)  # blue, green, red
_FRACTION = 4  # bits of a pixel in which OpenCV places a dot
_DOT_PX, _CROSS_PX = 1, 6  # radius of dots, half a cross, in the marked picture

Marked = npt.NDArray[np.uint8]  # (rows, columns, 3) blue, green, red


@dataclass(slots=True, kw_only=True)
class MarkedFolder:
    """A folder of marked pictures; a name is given once."""

    folder: Path
    _names: set[str] = field(default_factory=set)

    def write(self, found: MeasuredPicture) -> None:
        """Write a picture's region with the mark; MP702, MP703 if it cannot be."""
        ok, data = cv2.imencode(".png", marked(found))
        file = self.folder / f"{self._free(found)}.png"
        if not ok:
            raise OutputError(
                "MP702", f"{file}: the picture could not be encoded", file
            )
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise not_written(self.folder, error) from error
        replace_alike(file, data.tobytes())

    def _free(self, found: MeasuredPicture) -> str:
        """Return the picture's name without its suffix, numbered if it is taken."""
        page = found.name.removeprefix(found.path.name)
        own = name = found.path.stem + page
        number = 1
        while name in self._names:
            number += 1
            name = f"{own}-{number}"
        self._names.add(name)
        return name


def check_marks(folder: Path, pictures: Collection[Path]) -> None:
    """Raise MP703 if marked pictures would lie among those that are measured."""
    if folder.resolve() in {file.resolve().parent for file in pictures}:
        message = f"{folder} holds pictures to be measured; they are left untouched"
        raise OutputError("MP703", message, folder)


def marked(found: MeasuredPicture) -> Marked:
    """Return the region of a picture, enlarged, with contour and place of the target.

    Green if it was accepted, red if refused; nothing is drawn if nothing was found.
    """
    scale = max(1, math.ceil(LEAST_PX / found.shown.shape[1]))
    grey = picture(found.shown).repeat(scale, axis=0).repeat(scale, axis=1)
    image = np.dstack([grey] * 3)
    if found.x_um is None or found.y_um is None:
        return image
    colour = _ACCEPTED if found.is_accepted else _REFUSED
    case = found.region.case
    column, row = case.frame.to_pixel(found.x_um, found.y_um)
    for x, y in contour_px(case, (column, row), found.turn_rad):
        cv2.circle(
            image, _at(x, y, scale), _DOT_PX << _FRACTION, colour, -1, 8, _FRACTION
        )
    for dx, dy in ((_CROSS_PX, 0), (0, _CROSS_PX)):
        off = (dx / scale, dy / scale)
        ends = [_at(column + s * off[0], row + s * off[1], scale) for s in (-1, 1)]
        cv2.line(image, ends[0], ends[1], colour, 1, cv2.LINE_AA, _FRACTION)
    return image


def contour_px(
    case: LookCase, at_px: tuple[float, float], turn_rad: float | None
) -> FloatArray:
    """Return the drawn contour's points (N, 2), px of the region, at a place.

    `turn_rad` is that of the look's frame; None: as nominally.
    """
    own_rad = 0.0 if turn_rad is None else turn_rad - case.theta_rad
    target = replace(
        case.target,
        column=at_px[0],
        row=at_px[1],
        theta_rad=case.target.theta_rad + own_rad,
    )
    points = np.array(target.contour, dtype=np.float64).reshape(-1, 4)
    return place(points, target)[:, :2]


def _at(column: float, row: float, scale: int) -> tuple[int, int]:
    """Return a pixel of the region in the enlarged picture, in 1 / 2**_FRACTION px."""
    # the middle of pixel 0 is half an enlarged pixel into the picture
    fine = scale * 2**_FRACTION
    shift = 0.5 * (scale - 1) * 2**_FRACTION
    return (round(column * fine + shift), round(row * fine + shift))
