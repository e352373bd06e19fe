"""Templates of a target through focus, with its reference point in the world."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import (
    Backdrop,
    LookCase,
    moved_layers,
    render_look,
)
from microplan.featuresel.look.static_layers import standing
from microplan.featuresel.routines.contract import Failure, Measurement
from microplan.optics.render.scene import Illumination, Layer, Window
from microplan.optics.render.view_range import Range
from microplan.optics.transfer.microscope import Microscope


@dataclass(frozen=True, slots=True, kw_only=True)
class Located:
    """The target's reference point in the world, as one measurement has it."""

    x_um: float
    y_um: float
    theta_rad: float | None  # of the look's frame; None: not measured
    axis_rad: float | None  # the one direction in which the position is known, world


def located(case: LookCase, found: Measurement) -> Located | Failure:
    """Return where a measurement has the target's reference point.

    The angle is that of the frame that `LookCase.theta_rad` is of: the target's own may
    be turned against it, by as much as nominally. An answer with a number that is not
    finite is a failure, be it only a standard deviation or the score: gates compare
    those, and a nan passes or fails them by chance.
    """
    endless = _not_finite(found)
    if endless:
        return Failure("not_finite", f"not finite: {', '.join(endless)}")
    turned_rad = case.target.theta_rad - case.theta_rad
    theta = None if found.theta_rad is None else found.theta_rad - turned_rad
    x, y = case.frame.to_world(found.column, found.row)
    return Located(x_um=x, y_um=y, theta_rad=theta, axis_rad=found.axis_rad)


def _not_finite(found: Measurement) -> list[str]:
    """Return the names of an answer's numbers that are nan or infinite."""
    numbers = {field.name: getattr(found, field.name) for field in fields(found)}
    return [
        name
        for name, number in numbers.items()
        if number is not None and not math.isfinite(number)
    ]


def along(error_um: tuple[float, float], axis_rad: float | None) -> tuple[float, float]:
    """Return an error, or the part of it along the direction that is known."""
    if axis_rad is None:
        return error_um
    c, s = math.cos(axis_rad), math.sin(axis_rad)
    length = c * error_um[0] + s * error_um[1]
    return (length * c, length * s)


_NOTHING = Backdrop()
_POINT = 1e-12  # fill factor of samples that integrate over no area


def template(
    case: LookCase, dz_um: Sequence[float], *, over: int, half_px: tuple[int, int]
) -> FloatArray:
    """Return the target alone, (K, 2 R + 1, 2 C + 1) samples: see `LookModel`.

    Raises
    ------
    ValueError
        If `over` is even: no sample would be at a pixel's centre.
    """
    if over < 1 or over % 2 == 0:
        raise ValueError(f"over must be odd and positive, got {over}")
    fine = _fine(case, over, half_px)
    moved = moved_layers(fine, 0.0, 0.0, 0.0)
    heights = [fine.focus_um + dz for dz in dz_um]
    reach = Range(focus_um=(min(heights), max(heights)))
    ready = standing(fine, moved, reach, fine.model, keep=False)
    if ready is None:
        return np.stack([_pictured(fine, z, moved) for z in heights])
    return np.stack([_pictured(fine, z, (), ready.at(focus_um=z)) for z in heights])


def _fine(case: LookCase, over: int, half_px: tuple[int, int]) -> LookCase:
    """Return the target alone in a window of finer pixels about its nominal pose."""
    scope: Microscope = replace(
        case.microscope,
        pitch_um=case.microscope.pitch_um / over,
        width_px=case.microscope.width_px * over,
        height_px=case.microscope.height_px * over,
        fill_factor=_POINT,
        disc_side_um=case.microscope.shown_side_um,
    )
    return replace(
        case,
        static=(),
        microscope=scope,
        window=_window(case, over, half_px),
        # the light's gradient belongs to the frame, not to the target
        light=Illumination(gain=case.light.gain),
    )


def _window(case: LookCase, over: int, half_px: tuple[int, int]) -> Window:
    """Return the finer pixels about the target's nominal position."""
    column = case.window.column + round(case.target.column)
    row = case.window.row + round(case.target.row)
    middle = (over - 1) // 2
    return Window(
        row=(row - half_px[1]) * over + middle,
        column=(column - half_px[0]) * over + middle,
        rows=2 * half_px[1] * over + 1,
        columns=2 * half_px[0] * over + 1,
    )


def _pictured(
    fine: LookCase,
    focus_um: float,
    moved: tuple[Layer, ...],
    known: Backdrop = _NOTHING,
) -> FloatArray:
    """Return the picture of the target alone at one focus, `known` being blurred."""
    return render_look(replace(fine, focus_um=focus_um), moved, known)
