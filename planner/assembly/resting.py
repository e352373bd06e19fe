"""Support of a released part: carriers, overhang, stability."""

from __future__ import annotations

import math
from dataclasses import dataclass

import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from microplan.planner.assembly.assembly import Body, State, bodies, part_sigma_um
from microplan.planner.assembly.shapes import hull, polygon
from microplan.planner.assembly.swept_volume import ROUNDING_UM, SIGMAS
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task, TaskStep


@dataclass(frozen=True, slots=True, kw_only=True)
class Resting:
    """Support of a part by what is highest below it, at nominal positions."""

    on: tuple[str, ...]  # owners, by name; () is the stage's own surface
    beyond_um: float  # of its hull over the outer edges of what it lies on
    # of its centre of area within the edges that it may tip over; < 0: beyond them
    inside_um: float


def resting(task: Task, state: State, name: str) -> Resting:
    """Return the support of a part that is released in `state`.

    Supports that lie apart, or on both sides of a hole, carry what bridges them. The
    stage's surface has no edge.
    """
    everything = bodies(task, state)
    body = next(b for b in everything if b.name == name)
    shape = polygon(body.outline)
    stage_um = task.workcell.stage.datum_z_um + state.stage.z_um
    below = [b for b in everything if _is_below(b, body, shape)]
    top_um = max((b.z_high_um for b in below), default=stage_um)
    on = [b for b in below if b.z_high_um >= top_um - ROUNDING_UM]
    if not on or top_um <= stage_um:
        return Resting(on=(), beyond_um=0.0, inside_um=math.inf)
    carrier = shapely.union_all([polygon(b.outline) for b in on])
    carried = shape.intersection(carrier).convex_hull
    return Resting(
        on=tuple(sorted({b.owner for b in on})),
        beyond_um=_beyond_um(body, _filled(carrier)),
        inside_um=_inside_um(shape, carried),
    )


def report_resting(
    task: Task, state: State, step: TaskStep, name: str, report: Report
) -> None:
    """Report a part that is let go where it hangs over, or falls off."""
    found = resting(task, state, name)
    sure_um = SIGMAS * math.hypot(*(part_sigma_um(state, n) for n in (name, *found.on)))
    hangs = found.beyond_um > ROUNDING_UM
    if not found.on or not (hangs or found.inside_um < sure_um):
        return
    over = f"{found.beyond_um:.3g} um over the edge" if hangs else "over a hole"
    under = " and ".join(found.on)
    words = f"step {step.id!r}: {name} hangs {over} of {under}, its centre "
    if found.inside_um < sure_um:
        report.refuse(
            "MP308",
            step.where,
            f"{words}{found.inside_um:.3g} um inside it, {sure_um:.3g} um needed at 2 "
            "sigma: it may tip",
            "put it further onto what carries it",
        )
    else:
        words += f"{found.inside_um:.3g} um inside it"
        report.warning("MP308", step.where, words, "is it meant to?")


def _is_below(other: Body, body: Body, shape: BaseGeometry) -> bool:
    """Return whether a body on the stage lies under another one."""
    sigma_um = math.hypot(other.sigma_z_um, body.sigma_z_um)
    return (
        other.carrier == "stage"
        and other.owner != body.owner
        and other.z_high_um <= body.z_low_um + SIGMAS * sigma_um
        and shape.intersection(polygon(other.outline)).area > 0
    )


def _filled(shape: BaseGeometry) -> BaseGeometry:
    """Return a shape without its holes."""
    parts = getattr(shape, "geoms", [shape])
    filled: BaseGeometry = shapely.union_all([Polygon(p.exterior) for p in parts])
    return filled


def _beyond_um(body: Body, carrier: BaseGeometry) -> float:
    """Return how far the corners of a body's hull are beyond what carries it."""
    corners = shapely.get_coordinates(hull(body.outline))
    return max(carrier.distance(shapely.Point(corner)) for corner in corners)


def _inside_um(shape: BaseGeometry, carried: BaseGeometry) -> float:
    """Return how far the centre of area is inside the hull of what is carried.

    Where that ends with the part itself it tips over nothing: inf if all of it does.
    """
    middle = shape.centroid
    if not carried.contains(middle):
        return -float(carried.distance(middle))
    own = shape.convex_hull.boundary.buffer(ROUNDING_UM)
    edges = carried.boundary.difference(own)
    return math.inf if edges.is_empty else float(edges.distance(middle))
