"""Roundings of edges that a body has no room for."""

from __future__ import annotations

from collections.abc import Iterator

from microplan.optics.outline.offset import offset
from microplan.optics.outline.outline import Outline
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.task.finishes import SurfaceFinish
from microplan.planner.task.task import Task


def check_roundings(task: Task, report: Report) -> bool:
    """Return whether edges in a ring's light are finer than their walls are thick.

    Those that are not are reported.
    """
    has_room = True
    if not task.workcell.light.is_ring:
        return has_room
    for name, outline, surface, where in _rounded(task):
        radius_um = surface.edge_radius_um
        if not radius_um:
            continue
        try:
            offset(outline, -radius_um)
        except ValueError as error:
            message = f"edge_radius_um {radius_um:g} of {name} is too large for its "
            message += f"outline: {error}"
            hint = "it is less than half of the thinnest wall between two edges"
            report.error("MP116", where, message, hint)
            has_room = False
    return has_room


def _rounded(task: Task) -> Iterator[tuple[str, Outline, SurfaceFinish, Span]]:
    """Yield bodies with their outline and surface."""
    for name, part in sorted(task.parts.items()):
        yield name, part.outline, part.surface, part.where
        for key, post in sorted(part.posts.items()):
            yield f"{name}.{key}", post.outline, post.surface, post.where
    for name, tool in sorted(task.workcell.tools.items()):
        for finger in (tool.left, tool.right):
            yield name, finger, tool.surface, tool.where
