"""How the microscope is set for a look: zoom, focus, light, and the region cut out."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from optics.microscope import Microscope
from optics.scene import Layer, Window
from planner.diagnostics import Report, Span
from planner.inputs.task import Benchmark
from planner.inputs.workcell import Interval, Workcell
from planner.model.assembly import Place
from planner.model.sweep import SIGMAS
from planner.model.targets import Box, Shape

LADDER = math.sqrt(2.0)  # ratio of neighbouring magnifications that are tried
FINEST_PX = 4.0  # pixels that the finest detail must cover
SEARCH_SIGMAS = 3.0  # half-width of the search, in spreads of the target's place
CONTEXT_UM = 20.0  # surroundings that calipers need beyond the target
STOP_OVERLAP = 1.5  # of a usable side between stops: half of it is shared
BRIGHTEST = 0.95  # share of full scale that the brightest face may reach


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Where the file asks for a look, and what put its target where it is."""

    look: str  # id
    target: Span
    view: Span | None = None  # of the `view_um` that brought the target there
    spread: Span | None = None  # of the spread that it starts with


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewPlan:
    """One setting for one look."""

    microscope: Microscope
    focus_um: float
    light: float
    region: Window


def microscope_at(cell: Workcell, magnification: float) -> Microscope:
    """Return the microscope at one magnification."""
    return Microscope(
        aperture=cell.optics.aperture(magnification),
        wavelength_um=cell.optics.wavelength_um,
        medium_index=cell.optics.medium_index,
        magnification=magnification,
        pitch_um=cell.camera.pitch_um,
        width_px=cell.camera.width_px,
        height_px=cell.camera.height_px,
        fill_factor=cell.camera.fill_factor,
    )


def magnifications(
    cell: Workcell,
    shape: Shape,
    place: Place,
    current: float,
    report: Report,
    origin: Origin,
) -> tuple[float, ...]:
    """Return the magnifications that show the target, the present one first.

    A magnification qualifies if the target is inside the field at two sigma and its
    finest detail covers FINEST_PX pixels; beyond 4 pitch A / wavelength there is no
    more to see. Staying at the present one costs no time and no parcentric error; of
    the others the lowest come first. Reports why none qualifies.
    """
    rungs = _ladder(cell)
    fitting = [
        m for m in rungs if in_field(microscope_at(cell, m), shape.box_um, place)
    ]
    if not fitting:
        _report_field(cell, shape, place, report, origin)
        return ()
    sharp = [
        m for m in fitting if shape.finest_um * m / cell.camera.pitch_um >= FINEST_PX
    ]
    if not sharp:
        finest = FINEST_PX * cell.camera.pitch_um / max(fitting)
        report.refuse(
            "MP403",
            origin.target,
            f"the finest detail of {shape.name}, {shape.finest_um:.3g} um, is below "
            f"the {finest:.3g} um of {FINEST_PX:g} pixels at {max(fitting):g} x",
            "locate a larger feature first",
        )
        return ()
    useful = [m for m in sharp if m <= useful_magnification(cell, m)] or sharp[:1]
    return tuple(sorted(useful, key=lambda m: (m != current, m)))


def useful_magnification(cell: Workcell, magnification: float) -> float:
    """Return 4 pitch A / wavelength, above which pixels resolve nothing more."""
    aperture = cell.optics.aperture(magnification)
    return 4 * cell.camera.pitch_um * aperture / cell.optics.wavelength_um


def in_field(microscope: Microscope, box_um: Box, place: Place) -> bool:
    """Return whether the box about a place stays in the field at two sigma."""
    half_x, half_y = (size / 2 for size in microscope.field_um)
    spread = SIGMAS * place.sigma_xy_um
    x0, y0, x1, y1 = box_um
    return (
        place.pose.x_um + x1 + spread <= half_x
        and place.pose.x_um + x0 - spread >= -half_x
        and place.pose.y_um + y1 + spread <= half_y
        and place.pose.y_um + y0 - spread >= -half_y
    )


def focus_for(
    cell: Workcell, place: Place, report: Report, where: Span
) -> float | None:
    """Return the height to focus on, the target's face; report one out of reach."""
    focus = cell.optics.focus
    if focus.min_um <= place.z_um <= focus.max_um:
        return place.z_um
    report.refuse(
        "MP402",
        where,
        f"the face of {place.name} is {place.z_um:g} um high, the focus reaches "
        f"{focus.min_um:g} to {focus.max_um:g} um",
        "bring it to another height, or widen optics.focus in the workcell",
    )
    return None


def focus_stops(
    focus_um: float, usable_um: Interval, spread_um: float, limits_um: Interval
) -> tuple[float, ...]:
    """Return further heights to focus on where the target's own height is uncertain.

    Parameters
    ----------
    focus_um : float
        The first height tried.
    usable_um : (low, high)
        Focus errors at which the routine still measures, low <= 0 <= high.
    spread_um : float
        One sigma of the target's height.
    limits_um : (low, high)
        What the focus drive reaches.

    Returns
    -------
    tuple of float
        Nearest first, until SEARCH_SIGMAS are covered; empty if `focus_um` covers them.
        Neighbouring stops share half a usable side, so that none is left between them.
    """
    reach = SEARCH_SIGMAS * spread_um
    side = min(-usable_um[0], usable_um[1])
    if reach <= side or side <= 0:
        return ()
    count = math.ceil((reach - side) / (STOP_OVERLAP * side))
    offsets = [
        sign * k * STOP_OVERLAP * side for k in range(1, count + 1) for sign in (1, -1)
    ]
    low, high = limits_um
    return tuple(focus_um + d for d in offsets if low <= focus_um + d <= high)


def light_level(cell: Workcell, layers: Iterable[Layer], spread: Benchmark) -> float:
    """Return the light level at which the brightest face keeps below full scale."""
    faces = [layer.reflectance for layer in layers]
    brightest = max([*faces, cell.stage.reflectance])
    worst = brightest * spread.light_gain[1] * (1 + spread.light_gradient[1] / 2)
    low, high = cell.light.level
    return max(low, min(high, BRIGHTEST / worst)) if worst > 0 else high


def region_for(
    microscope: Microscope, box_um: Box, place: Place, search_um: float
) -> Window:
    """Return the part of the frame that holds the target wherever it may be.

    Trials reach `search_um`, and there half the surroundings will do.
    """
    room = max(
        SEARCH_SIGMAS * place.sigma_xy_um + CONTEXT_UM, search_um + CONTEXT_UM / 2
    )
    k = microscope.px_per_um
    x0, y0, x1, y1 = box_um
    cx = (microscope.width_px - 1) / 2 + k * place.pose.x_um
    cy = (microscope.height_px - 1) / 2 - k * place.pose.y_um
    left = max(0, math.floor(cx + k * (x0 - room)))
    right = min(microscope.width_px, math.ceil(cx + k * (x1 + room)) + 1)
    top = max(0, math.floor(cy - k * (y1 + room)))
    bottom = min(microscope.height_px, math.ceil(cy - k * (y0 - room)) + 1)
    return Window(row=top, column=left, rows=bottom - top, columns=right - left)


def _ladder(cell: Workcell) -> list[float]:
    """Return the magnifications tried, lowest first."""
    low, high = cell.optics.magnification
    count = math.floor(math.log(high / low) / math.log(LADDER) + 1e-9)
    rungs = [low * LADDER**i for i in range(count + 1)]
    return rungs if math.isclose(rungs[-1], high) else [*rungs, high]


def _report_field(
    cell: Workcell,
    shape: Shape,
    place: Place,
    report: Report,
    origin: Origin,
) -> None:
    """Report a target that is outside the field at every magnification, and why."""
    lowest = microscope_at(cell, cell.optics.magnification[0])
    width, height = lowest.field_um
    x0, y0, x1, y1 = shape.box_um
    middle = (-(x0 + x1) / 2, -(y0 + y1) / 2)  # where the box is in the middle
    centred = replace(place, pose=replace(place.pose, x_um=middle[0], y_um=middle[1]))
    if not in_field(lowest, shape.box_um, replace(centred, sigma_xy_um=0.0)):
        at, what = None, "too large for"
        hint = "allow a lower magnification, or target a smaller feature"
    elif not in_field(lowest, shape.box_um, centred):
        at, what = origin.spread, "too uncertain for"
        hint = "place it better at the start, or locate something larger on it first"
    else:
        at, what = origin.view, "not inside"
        away = (place.pose.x_um - middle[0], place.pose.y_um - middle[1])
        hint = (
            f"bring it nearer the middle of the field, by up to ({-away[0]:.4g}, "
            f"{-away[1]:.4g}) um: with 'view_um' if it is on the stage"
        )
    report.refuse(
        "MP401",
        at or origin.target,
        f"look {origin.look!r}: {shape.name} is {x1 - x0:.4g} x {y1 - y0:.4g} um at "
        f"({place.pose.x_um:.4g}, {place.pose.y_um:.4g}) um, give or take "
        f"{SIGMAS * place.sigma_xy_um:.3g} um: "
        f"{what} the field of {width:.4g} x {height:.4g} um at the lowest "
        f"magnification {lowest.magnification:g}",
        hint,
    )
