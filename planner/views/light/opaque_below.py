"""What keeps light from below off a target: opaque bodies under its edges."""

from __future__ import annotations

import numpy as np
import shapely

from microplan.arrays import FloatArray
from microplan.planner.assembly.assembly import Body, State, bodies
from microplan.planner.assembly.shapes import polygon
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.task.task import Task
from microplan.planner.views.targets import TargetShape

_MOST = 0.5  # share of dark edges from which a target cannot be seen
_LEAST = 0.01
_ROUNDING_UM = 1e-6  # heights so close are one


def report_opaque(
    task: Task,
    state: State,
    shape: TargetShape,
    z_um: float,
    points_um: FloatArray,
    where: Span,
    report: Report,
) -> bool:
    """Report opaque bodies under a target in light from below; True if it is dark.

    Parameters
    ----------
    z_um : float
        World height of the target's face.
    points_um : (N, 2) float array
        Points all along its edges, in the world.
    where : Span
        Of the look.
    """
    if not task.workcell.light.is_transmitted:
        return False
    points = shapely.points(points_um)
    dark = np.zeros(len(points_um), dtype=np.bool_)
    by = []
    for body in bodies(task, state):
        if not _is_under(task, body, shape, z_um):
            continue
        under = shapely.intersects(polygon(body.outline), points)
        if under.any():
            by.append(body.name)
            dark |= under
    share = float(dark.mean())
    if share < _LEAST:
        return False
    words = f"{shape.name} has opaque bodies under {share:.0%} of its edges in light "
    words += f"from below: {', '.join(by)}"
    hint = "state their 'transmittance' if they let light pass, or light it from above"
    if share < _MOST:
        report.warning("MP407", where, words, hint)
        return False
    report.refuse("MP407", where, words, hint)
    return True


def _is_under(task: Task, body: Body, shape: TargetShape, z_um: float) -> bool:
    """Return whether a body is opaque, no higher than a face, and not the target's."""
    if body.z_high_um > z_um + _ROUNDING_UM or body.surface.transmittance > 0:
        return False
    return body.name != shape.body and body.owner not in task.workcell.tools
