"""The world of the simulated cell, its solids as convex polygons of few corners."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields
from typing import TypeVar

import numpy as np
import shapely

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Edge, Outline, Segment
from microplan.planner.assembly.assembly import Axis4, Carrier, State
from microplan.planner.assembly.shapes import CHORD_UM, hull
from microplan.planner.task.task import Part, Reading, Task
from microplan.planner.task.workcell import AxesSpec, Tool
from microplan.schemas.files.world import (
    World,
    WorldAxes,
    WorldHole,
    WorldLens,
    WorldMark,
    WorldOptics,
    WorldOutline,
    WorldPart,
    WorldPost,
    WorldRing,
    WorldTool,
)
from microplan.schemas.plan import AxisMove
from microplan.schemas.plan.views import MOST_CORNERS, Fingers, Prism, Solid
from microplan.schemas.pose import Pose

T = TypeVar("T")

ROUNDING = 4  # decimals, um: far within CHORD_UM, by which every prism is wider
TIE = 1e-6  # relative: areas that differ by less are equal but for rounding
_PARALLEL = 1e-12  # of the lengths' product: edges whose neighbours never meet


def part_solids(task: Task) -> tuple[Solid, ...]:
    """Return every part's plate and posts, by name."""
    return tuple(
        Solid(name=part.name, prisms=tuple(_prisms(part)))
        for _, part in sorted(task.parts.items())
    )


def finger_solids(task: Task) -> tuple[Fingers, ...]:
    """Return the fingers of every tool that the task uses, by name."""
    tools = (task.workcell.tools[name] for name in sorted(task.tool_starts))
    return tuple(
        Fingers(
            tool=tool.name,
            left=_prism(tool.left, 0.0, tool.thickness_um),
            right=_prism(tool.right, 0.0, tool.thickness_um),
        )
        for tool in tools
    )


def few_corners(corners: FloatArray, most: int = MOST_CORNERS) -> FloatArray:
    """Return a convex polygon of at most `most` corners around a convex polygon.

    The edge goes first whose going adds the least area: its neighbours are drawn out
    until they meet.

    Parameters
    ----------
    corners : (N, 2) float array
        Counter-clockwise, um.
    most : int
        At least 4, for less may not enclose anything.

    Returns
    -------
    (M, 2) float array
        Counter-clockwise, um; M <= max(N, most).

    Raises
    ------
    ValueError
        If `most` is below 4.
    """
    if most < 4:
        raise ValueError(f"a polygon needs room for 4 corners, got {most}")
    left = corners
    while len(left) > most:
        areas, tips = _tips(left)
        least = float(areas.min())
        if math.isinf(least):  # no edge can go
            break
        k = int(np.argmax(areas <= least * (1 + TIE)))  # the first of the least
        left = np.roll(left, -k, axis=0)  # edge k is now the first
        left = np.concatenate((tips[k : k + 1], left[2:]))
    return left


def _tips(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the area that each edge's going adds, (N,), and where its neighbours
    meet, (N, 2)."""
    start, end = corners, np.roll(corners, -1, axis=0)
    out, ahead = start - np.roll(corners, 1, axis=0), np.roll(corners, -2, axis=0) - end
    along, cross = end - start, _cross(out, ahead)
    lengths = np.hypot(*out.T) * np.hypot(*ahead.T)
    meet = cross > _PARALLEL * lengths
    share = _cross(along, ahead) / np.where(meet, cross, 1.0)
    tips = start + share[:, None] * out
    areas = np.where(meet, np.abs(_cross(along, tips - start)) / 2, np.inf)
    return areas, tips


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products of plane vectors, (N, 2) each, (N,)."""
    crossed: FloatArray = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return crossed


def _prisms(part: Part) -> Iterator[Prism]:
    """Yield the prism of a part's plate, then those of its posts."""
    foot_um = part.thickness_um
    yield _prism(part.outline, 0.0, foot_um)
    for post in part.posts.values():
        yield _prism(post.outline, foot_um, foot_um + post.height_um)


def _prism(outline: Outline, low_um: float, high_um: float) -> Prism:
    """Return the prism around an outline; chords are put outside their arcs."""
    around = hull(outline).buffer(CHORD_UM, join_style="mitre")
    ring = shapely.geometry.polygon.orient(around).exterior
    corners = few_corners(shapely.get_coordinates(ring)[:-1])
    rounded = np.round(corners, ROUNDING) + 0.0  # never -0.0
    return Prism(
        corners_um=tuple((float(x), float(y)) for x, y in rounded),
        low_um=low_um,
        high_um=high_um,
    )


def build_world(task: Task, start: State) -> World:
    """Return everything the simulated cell contains."""
    cell = task.workcell
    return World(
        name=task.name,
        optics=_optics(task),
        stage=_axes("stage", cell.stage.axes, start.stage),
        stage_datum_z_um=cell.stage.datum_z_um,
        stage_reflectance=cell.stage.reflectance,
        stage_theta_axis_um=cell.stage.theta_axis_um,
        stage_tilt_sigma_rad=cell.stage.axis_tilt_sigma_rad,
        stage_drift_um_per_min=cell.stage.drift_um_per_min,
        robot=_axes("robot", cell.robot.axes, start.robot),
        robot_theta_axis_to_tip_um=cell.robot.theta_axis_to_tip_um,
        parts=tuple(_part(task, task.parts[name]) for name in sorted(start.parts)),
        tools=tuple(
            _tool(cell.tools[name], task.tool_starts[name].opening_um)
            for name in sorted(task.tool_starts)
        ),
    )


def world_outline(outline: Outline) -> WorldOutline:
    """Return an outline as plain numbers, arcs kept."""
    return WorldOutline(
        rings=tuple(
            WorldRing(layer=ring.layer, edges=tuple(map(_numbers, ring.edges)))
            for ring in outline.rings
        )
    )


def _numbers(edge: Edge) -> tuple[float, ...]:
    """Return an edge as plain numbers: two ends, or centre, radius, start, sweep."""
    if isinstance(edge, Segment):
        return (*edge.start, *edge.end)
    return (*edge.center, edge.radius_um, edge.start_rad, edge.sweep_rad)


def _of(kind: type[T], *sources: object, **given: object) -> T:
    """Return a value of `kind`: fields as given, the others as sources name them."""
    taken = {
        field.name: getattr(source, field.name)
        for source in sources
        for field in fields(kind)  # type: ignore[arg-type]  # all are dataclasses
        if hasattr(source, field.name)
    }
    return kind(**{**taken, **given})


def _part(task: Task, part: Part) -> WorldPart:
    """Return a part with its holes, posts, marks and start."""
    start = task.part_starts[part.name]
    return _of(
        WorldPart,
        part,
        start,
        outline=world_outline(part.outline),
        posts=tuple(
            _of(
                WorldPost,
                post,
                name=f"{part.name}.{post.name}",
                outline=world_outline(post.outline),
                wall_reflectance=post.surface.wall,
                finish=post.surface.finish,
            )
            for post in part.posts.values()
        ),
        holes=tuple(
            _of(WorldHole, feature, name=f"{part.name}.{feature.name}")
            for feature in part.features.values()
            if feature.kind == "circle" and feature.hole and not feature.on
        ),
        marks=tuple(
            _of(
                WorldMark,
                mark,
                name=f"{part.name}.{mark.name}",
                on=f"{part.name}.{mark.on}" if mark.on else part.name,
                outline=world_outline(mark.outline),
            )
            for mark in part.marks.values()
        ),
        wall_reflectance=part.surface.wall,
        finish=part.surface.finish,
        start=Pose(x_um=start.x_um, y_um=start.y_um, theta_rad=start.theta_rad),
    )


def _tool(tool: Tool, opening_um: float) -> WorldTool:
    """Return a tool with its jaws closed in the drawing."""
    return _of(
        WorldTool,
        tool,
        left=world_outline(tool.left),
        right=world_outline(tool.right),
        start_opening_um=opening_um,
        wall_reflectance=tool.surface.wall,
        finish=tool.surface.finish,
    )


def axis_move(
    axes: Carrier, to: Axis4 | Reading, speed_um_per_s: float | None = None
) -> AxisMove:
    """Return the move of one group of axes to a reading, as the plan has it."""
    return AxisMove(
        axes=axes,
        x_um=to.x_um,
        y_um=to.y_um,
        z_um=to.z_um,
        theta_rad=to.theta_rad,
        speed_um_per_s=speed_um_per_s,
    )


def _axes(name: Carrier, axes: AxesSpec, start: Axis4) -> WorldAxes:
    """Return one axis group with its start readings."""
    limits = {key: axes.limits[key] for key in sorted(axes.limits)}
    return _of(WorldAxes, axes, start=axis_move(name, start), limits=limits)


def _optics(task: Task) -> WorldOptics:
    """Return microscope and camera."""
    optics, camera = task.workcell.optics, task.workcell.camera
    lens = optics.lens  # each cell draws its own of what is unknown
    lateral = (lens.lateral_x, lens.lateral_y)
    halo = optics.halo
    return _of(
        WorldOptics,
        optics,
        camera,
        optics.zoom,
        optics.focus,
        zoom_time_s=optics.zoom.time_s,
        focus_um=(optics.focus.min_um, optics.focus.max_um),
        focus_time_s=optics.focus.time_s,
        focus_repeatability_um=optics.focus.repeatability_um,
        frame_time_s=1 / camera.rate_hz,
        light=task.workcell.light.level,
        light_gradient=task.workcell.light.gradient,
        response=() if camera.response is None else camera.response.rows,
        lens=_of(WorldLens, lens, lateral_um_per_um=lateral),
        lamp_share=_lamp_share(task),
        light_kind=task.workcell.light.kind,
        discrepancy_edge=task.workcell.discrepancy.edge,
        discrepancy_flat=task.workcell.discrepancy.flat,
        discrepancy_pixel=task.workcell.discrepancy.pixel,
        wavefront=optics.wavefront.known,
        halo_radius_um=0.0 if halo is None else halo.radius_um,
        halo_share=0.0 if halo is None else halo.share,
    )


def _lamp_share(task: Task) -> float:
    """Return the aperture of coaxial light over the lens': see `lens_errors`."""
    if task.workcell.light.kind != "coaxial":
        return 0.0
    coherence = task.workcell.optics.coherence
    return 1.0 if coherence is None else min(coherence.most, 1.0)
