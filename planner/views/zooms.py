"""Magnifications that a look allows: a closed interval with the rungs tried in it."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

from microplan.arrays import Box
from microplan.optics.outline.tolerant_order import at_most
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.assembly.assembly import Place
from microplan.planner.assembly.swept_volume import SIGMAS
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.task.workcell import Workcell
from microplan.planner.views.light.lit_layers import lamp_below
from microplan.planner.views.targets import TargetShape
from microplan.schemas.plan.views import ZoomBound

LADDER = math.sqrt(2.0)  # ratio of neighbouring magnifications that are tried
FINEST_PX = 4.0  # pixels that the finest detail must cover


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Where the file asks for a look, and what put its target where it is."""

    look: str  # id
    target: Span
    view: Span | None = None  # of the `view_um` that brought the target there
    sigma: Span | None = None  # of the sigma that it starts with


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoomRange:
    """The magnifications at which a target is in the field and its detail resolved."""

    least: float
    most: float  # below `least` if there are none
    ceiling: float  # beyond it pixels resolve nothing more; at least the workcell's low
    bounds: tuple[ZoomBound, ...]

    @property
    def useful(self) -> float:
        """Return the largest magnification that is worth a look."""
        return max(self.least, min(self.most, self.ceiling))


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
        lamp_aperture=lamp_below(cell),
        wavefront=cell.optics.wavefront.known,
        halo=None if cell.optics.halo is None else cell.optics.halo.known,
    )


def zoom_range(cell: Workcell, shape: TargetShape, place: Place) -> ZoomRange:
    """Return the magnifications that show a target, in closed form.

    At least those that give the finest detail FINEST_PX pixels of the camera's pitch p,
    FINEST_PX p / detail; at most those whose field holds the target's box with two
    sigma of its position on either side. In the middle of a field of W x H pixels that
    is W p / (box + 4 sigma), or H. The workcell limits both. Beyond 4 p A / wavelength
    (two pixels to the shortest period that the lens passes) nothing more is resolved.
    """
    low, high = cell.optics.magnification
    finest = math.inf  # closed jaws have no gap to see
    if shape.finest_um > 0:
        finest = FINEST_PX * cell.camera.pitch_um / shape.finest_um
    field = field_limit(cell, shape.box_um, place)
    ceiling = useful_ceiling(cell) or low
    x0, y0, x1, y1 = shape.box_um
    bounds = [
        ZoomBound(end="least", magnification=low, by="workcell", reason="the lowest"),
        ZoomBound(
            end="least",
            magnification=finest,
            by="finest detail",
            reason=f"{FINEST_PX:g} pixels on {shape.finest_um:.3g} um",
        ),
        ZoomBound(
            end="most",
            magnification=field,
            by="field",
            reason=f"{x1 - x0:.4g} x {y1 - y0:.4g} um with {SIGMAS:g} sigma of "
            f"{place.frame_sigma_um:.3g} um to each side",
        ),
        ZoomBound(end="most", magnification=high, by="workcell", reason="the highest"),
    ]
    if ceiling < high:
        ends = ZoomBound(
            end="most",
            magnification=ceiling,
            by="useful ceiling",
            reason="two pixels to the shortest period that the lens passes",
        )
        bounds.append(ends)
    return ZoomRange(
        least=max(low, finest),
        most=min(high, field),
        ceiling=ceiling,
        bounds=tuple(bounds),
    )


def field_limit(cell: Workcell, box_um: Box, place: Place) -> float:
    """Return the magnification at which a box and two sigma just reach the rim."""
    camera, margin_um = cell.camera, SIGMAS * place.frame_sigma_um
    x0, y0, x1, y1 = box_um
    x, y = place.pose.x_um, place.pose.y_um
    reach_um = (max(x + x1, -(x + x0)) + margin_um, max(y + y1, -(y + y0)) + margin_um)
    sides_um = (
        camera.pitch_um * camera.width_px / 2,
        camera.pitch_um * camera.height_px / 2,
    )
    return min(s / r for s, r in zip(sides_um, reach_um, strict=True))


def useful_ceiling(cell: Workcell) -> float | None:
    """Return the largest magnification not beyond 4 pitch A / wavelength.

    None if all are beyond. Between the rows of the aperture's table its logarithm is
    linear in that of the magnification, so that the last crossing has a closed form.
    """
    low, high = cell.optics.magnification
    rows = sorted(m for m, _ in cell.optics.apertures if low < m < high)
    nodes = [low, *rows, high]
    left = [math.log(useful_magnification(cell, m) / m) for m in nodes]
    if left[-1] >= 0:
        return high
    pairs = itertools.pairwise(zip(nodes, left, strict=True))
    for (m, here), (beyond, there) in reversed(list(pairs)):
        if here >= 0:
            return float(m * (beyond / m) ** (here / (here - there)))
    return None


def magnifications(
    cell: Workcell,
    shape: TargetShape,
    place: Place,
    current: float,
    report: Report,
    origin: Origin,
) -> tuple[float, ...]:
    """Return the magnifications that show the target, the present one first.

    Rungs of a ladder inside `zoom_range`, or its middle where it lies between two.
    Staying at the present one costs no time and no parcentric error; of the others the
    lowest come first. Reports why none qualifies.
    """
    found = zoom_range(cell, shape, place)
    if found.most < cell.optics.magnification[0]:
        _report_field(cell, shape, place, report, origin)
        return ()
    if found.most < found.least:
        held = f"the field holds {shape.name} with {SIGMAS:g} sigma of its place"
        if found.most >= cell.optics.magnification[1]:
            held = "the workcell goes"
        report.refuse(
            "MP403",
            origin.target,
            f"look {origin.look!r}: {FINEST_PX:g} pixels on the finest detail of "
            f"{shape.name}, {shape.finest_um:.3g} um, take {found.least:.4g} x, "
            f"{held} up to {found.most:.4g} x",
            "locate a larger feature first",
        )
        return ()
    rungs = [
        m for m in ladder(cell) if at_most(found.least, m) and at_most(m, found.most)
    ]
    if not rungs:
        rungs = [math.sqrt(found.least * found.most)]
    useful = [m for m in rungs if at_most(m, useful_magnification(cell, m))]
    useful = useful or rungs[:1]
    return tuple(sorted(useful, key=lambda m: (m != current, m)))


def useful_magnification(cell: Workcell, magnification: float) -> float:
    """Return 4 pitch A / wavelength, above which pixels resolve nothing more."""
    aperture = cell.optics.aperture(magnification)
    return 4 * cell.camera.pitch_um * aperture / cell.optics.wavelength_um


def in_field(microscope: Microscope, box_um: Box, place: Place) -> bool:
    """Return whether a box stays in the field at two sigma."""
    half_x, half_y = (size / 2 for size in microscope.field_um)
    margin_um = SIGMAS * place.frame_sigma_um
    x0, y0, x1, y1 = box_um
    return (
        place.pose.x_um + x1 + margin_um <= half_x
        and place.pose.x_um + x0 - margin_um >= -half_x
        and place.pose.y_um + y1 + margin_um <= half_y
        and place.pose.y_um + y0 - margin_um >= -half_y
    )


def ladder(cell: Workcell) -> list[float]:
    """Return the magnifications tried, lowest first."""
    low, high = cell.optics.magnification
    count = math.floor(math.log(high / low) / math.log(LADDER) + 1e-9)
    rungs = [low * LADDER**i for i in range(count + 1)]
    return rungs if math.isclose(rungs[-1], high) else [*rungs, high]


def _report_field(
    cell: Workcell,
    shape: TargetShape,
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
    certain = replace(centred, sigma_xy_um=0.0, followed_um=0.0)
    if not in_field(lowest, shape.box_um, certain):
        at, what = None, "too large for"
        hint = "allow a lower magnification, or target a smaller feature"
    elif not in_field(lowest, shape.box_um, centred):
        at, what = origin.sigma, "too uncertain for"
        hint = "place it better at the start, or locate something larger on it first"
    else:
        at, what = origin.view, "not inside"
        away = (place.pose.x_um - middle[0], place.pose.y_um - middle[1])
        hint = (
            f"bring it nearer the middle of the field, by up to ({0 - away[0]:.4g}, "
            f"{0 - away[1]:.4g}) um: with 'view_um' if it is on the stage"
        )
    report.refuse(
        "MP401",
        at or origin.target,
        f"look {origin.look!r}: {shape.name} is {x1 - x0:.4g} x {y1 - y0:.4g} um at "
        f"({place.pose.x_um:.4g}, {place.pose.y_um:.4g}) um, give or take "
        f"{SIGMAS * place.frame_sigma_um:.3g} um: "
        f"{what} the field of {width:.4g} x {height:.4g} um at the lowest "
        f"magnification {lowest.magnification:g}",
        hint,
    )
