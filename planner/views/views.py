"""Setting of the microscope for a look: magnification, focus, light, region."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from microplan.arrays import Box
from microplan.optics.render.scene import Layer, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.assembly.assembly import Place
from microplan.planner.task.task import Benchmark
from microplan.planner.task.workcell import Workcell

SEARCH_SIGMAS = 3.0  # half-width of the search, in sigmas of the target's position
CONTEXT_UM = 20.0  # surroundings that calipers need beyond the target
# a line narrower than the lens shows loses its brightness by so much
LINE_UM = 0.7
BRIGHTEST = 0.95  # share of full scale that the brightest face may reach


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewPlan:
    """One setting for one look."""

    microscope: Microscope
    focus_um: float
    light: float
    region: Window


def light_level(
    cell: Workcell, layers: Iterable[Layer], spread: Benchmark, background: float
) -> float:
    """Return the light level at which the brightest face keeps below full scale.

    `background` is what lies below all layers; a line of an edge counts by what the
    lens makes of it, its width over the resolution.
    """
    shown = tuple(layers)
    faces = [layer.reflectance for layer in shown]
    lines = [
        layer.reflectance + min(line.width_um / LINE_UM, 1.0) * line.level
        for layer in shown
        if (line := layer.edge_line) is not None
    ]
    brightest = max([*faces, *lines, background])
    worst = brightest * spread.light_gain[1] * (1 + spread.light_gradient[1] / 2)
    low, high = cell.light.level
    return max(low, min(high, BRIGHTEST / worst)) if worst > 0 else high


def region_for(
    microscope: Microscope, box_um: Box, place: Place, search_um: float
) -> Window:
    """Return the part of the frame that holds the target wherever it may be.

    Trials reach `search_um`, and there half the surroundings will do. By `followed_um`
    the region moves with the target (`View.follows`): that needs no room in it.
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
