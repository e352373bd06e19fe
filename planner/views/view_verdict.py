"""The verdict on a look's settings: allowed zooms, the aperture table, focus stops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from microplan.planner.assembly.assembly import height_sigma_um
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import Interval, Workcell
from microplan.planner.views.focus import covered_um, reach_margin_um
from microplan.planner.views.requests import Request
from microplan.planner.views.target_views import needed_shape, zooms_of
from microplan.planner.views.zooms import ZoomRange, ladder, microscope_at
from microplan.schemas.plan import View
from microplan.schemas.plan.views import (
    ApertureRow,
    FocusAccepted,
    FocusCover,
    ViewVerdict,
    ZoomBound,
    ZoomLimits,
    ZoomTried,
)


def view_verdict(
    task: Task,
    request: Request,
    view: View,
    usable_um: Mapping[str, Interval],
    refused: Sequence[ZoomTried],
) -> ViewVerdict:
    """Return why a look is set as it is.

    Parameters
    ----------
    task, request : Task, Request
        What is looked for.
    view : View
        As it is set.
    usable_um : mapping of feature to (low, high)
        Focus errors at which the trials still measured it.
    refused : sequence of ZoomTried
        What the trials said no to before.
    """
    zoom = _limits(zooms_of(task, request), view.magnification, refused)
    owner = needed_shape(task, request).owner
    return ViewVerdict(
        zoom=zoom,
        apertures=_apertures(task.workcell, zoom, view.magnification),
        focus=_cover(
            view, usable_um, height_sigma_um(task, request.state, owner), task.workcell
        ),
    )


def _limits(
    found: ZoomRange, chosen: float, refused: Sequence[ZoomTried]
) -> ZoomLimits:
    """Return the closed interval, from below cut off by what the trials refused."""
    below = [t for t in refused if t.magnification < chosen]
    bounds, least = found.bounds, found.least
    if below:
        last = max(below, key=lambda tried: tried.magnification)
        least = max(least, last.magnification)
        bounds = (
            *bounds,
            ZoomBound(
                end="least",
                magnification=last.magnification,
                by="trials",
                reason=f"not good enough there: {last.reason}",
            ),
        )
    return ZoomLimits(
        least=least,
        most=max(found.useful, chosen),
        bounds=bounds,
        refused=tuple(refused),
    )


def _apertures(
    cell: Workcell, zoom: ZoomLimits, chosen: float
) -> tuple[ApertureRow, ...]:
    """Return the microscope at every rung that the interval allows, and as chosen."""
    rungs = {m for m in ladder(cell) if zoom.least <= m <= zoom.most}
    return tuple(
        _aperture(cell, m, chosen=m == chosen) for m in sorted(rungs | {chosen})
    )


def _aperture(cell: Workcell, magnification: float, *, chosen: bool) -> ApertureRow:
    """Return what the microscope is at a magnification."""
    scope = microscope_at(cell, magnification)
    return ApertureRow(
        magnification=magnification,
        aperture=scope.aperture,
        um_per_px=scope.um_per_px,
        cutoff_um=1 / scope.cutoff_per_um,
        depth_um=scope.wave_depth_um,
        field_um=scope.field_um,
        chosen=chosen,
    )


def _cover(
    view: View, usable_um: Mapping[str, Interval], sigma_um: float, cell: Workcell
) -> FocusCover:
    """Return which heights of the target the focus stops take in."""
    stops = [z - view.focus_um for z in (view.focus_um, *view.focus_stops_um)]
    margin_um = reach_margin_um(cell)
    return FocusCover(
        accepted=tuple(
            FocusAccepted(
                feature=name,
                least_um=view.focus_um + low,
                most_um=view.focus_um + high,
            )
            for name, (low, high) in usable_um.items()
        ),
        sigma_um=sigma_um,
        margin_um=margin_um,
        covered_um=covered_um(stops, list(usable_um.values()), margin_um),
        stops=len(stops),
    )
