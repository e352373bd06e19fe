"""Scenes of looks: layers in view, shares of edges that higher bodies hide or shade."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Edge, Outline, Segment, place
from microplan.optics.outline.tolerant_order import least
from microplan.optics.render.scene import Layer, Scene
from microplan.planner.assembly.assembly import (
    Body,
    Place,
    State,
    bodies,
    part_pose,
    robot_pose,
)
from microplan.planner.assembly.shapes import polygon
from microplan.planner.assembly.world import axis_move
from microplan.planner.task.task import Task
from microplan.planner.views.light.lit_layers import (
    asks_for_walls,
    lit_layers,
    stage_level,
)
from microplan.planner.views.targets import TargetShape, face_layers, outline_of
from microplan.schemas.files.evidence import LookScene, PlacedBody, SeenTarget
from microplan.schemas.plan import Shade
from microplan.schemas.pose import Pose


def look_scene(
    task: Task, state: State, look: str, shape: TargetShape, target_at: Place
) -> LookScene:
    """Return the assembly at a look, and which edges the look is at."""
    return LookScene(
        look=look,
        target=_target(task, shape, target_at),
        stage=axis_move("stage", state.stage),
        robot=None if state.tool is None else axis_move("robot", state.robot),
        opening_um=None if state.tool is None else state.opening_um,
        bodies=tuple(
            PlacedBody(
                name=name,
                pose=_pose(task, state, body.owner, body.name),
                z_um=body.z_high_um,
            )
            for body in bodies(task, state)
            for name in (body.name, *(mark for mark, *_ in body.marks))
        ),
    )


def _target(task: Task, shape: TargetShape, target_at: Place) -> SeenTarget:
    """Return whose edges a look is at; of a circle or region, those of the one ring."""
    if shape.owner in task.workcell.tools:
        names, ring = tuple(f"{shape.owner}.{side}" for side in ("left", "right")), None
    else:
        names, ring = (shape.body,), target_ring(outline_of(task, shape), shape)
    return SeenTarget(name=shape.name, pose=target_at.pose, bodies=names, ring=ring)


def _pose(task: Task, state: State, owner: str, name: str) -> Pose:
    """Return the pose of a body; jaws have moved by half the opening from closed."""
    if owner != state.tool:
        return part_pose(task, state, owner)
    half = state.opening_um / 2
    shift_um = -half if name.endswith(".left") else half
    return robot_pose(state.robot).compose(Pose(x_um=shift_um, y_um=0.0))


# Points along all edges whose shade is counted. A stretch of edge that is hidden is
# counted to within one point, so its share to within 1 / 2000.
EDGE_POINTS = 2000


def world_scene(task: Task, state: State) -> Scene:
    """Return everything in the world as layers, whether in view or not.

    They send what the workcell's light makes them send.
    """
    walls = asks_for_walls(task.workcell)
    return Scene(
        layers=lit_layers(
            task,
            [
                layer
                for body in bodies(task, state)
                for layer in _layers(body, walls=walls)
            ],
        ),
        background=stage_level(task.workcell),
        background_z_um=task.workcell.stage.datum_z_um + state.stage.z_um,
    )


def shade_of(
    task: Task,
    state: State,
    shape: TargetShape,
    target_at: Place,
    aperture: float,
    index: float,
) -> tuple[Shade, ...]:
    """Return how much of the target's edges each higher body hides or shades.

    A body h above a point shades it within h tan(asin(A / n)) of its outline; right
    above it, it hides it. Shares are of the edges' length; each unbroken stretch adds
    an error of at most 1 / EDGE_POINTS.
    """
    if shape.owner in task.workcell.tools:
        return ()
    points = shapely.points(edge_points(task, shape, target_at))
    slope = math.tan(math.asin(aperture / index))
    found = []
    for body in bodies(task, state):
        height = body.z_high_um - target_at.z_um
        if body.name == target_at.name or height <= 0 or _is_own_face(body, shape):
            continue
        solid = polygon(body.outline)
        shapely.prepare(solid)  # 2000 points ask it twice
        hidden = float(np.mean(shapely.intersects(solid, points)))
        shaded = float(np.mean(shapely.dwithin(solid, points, height * slope))) - hidden
        if hidden or shaded:
            found.append(
                Shade(target=shape.name, by=body.name, hidden=hidden, shaded=shaded)
            )
    return tuple(found)


def _is_own_face(body: Body, shape: TargetShape) -> bool:
    """Return whether the body is the very face that is looked at."""
    return body.name in (shape.name, shape.owner, shape.body)


def _layers(body: Body, *, walls: bool) -> tuple[Layer, ...]:
    """Return a body and the marks on it for images.

    It is solid where its wall or its finish is stated, or the light asks for walls:
    from below and from the side they hide the most. Others are their top faces: walls
    cost an image several times its time.
    """
    is_solid = (walls or any(body.surface.stated)) and body.z_low_um < body.z_high_um
    return tuple(
        replace(
            layer,
            underside_um=body.z_low_um if is_solid else None,
            wall_reflectance=body.surface.seen_wall,
            finish=body.surface.seen_finish,
        )
        for layer in face_layers(
            body.name, body.outline, body.z_high_um, body.reflectance, body.marks
        )
    )


def edge_points(task: Task, shape: TargetShape, target_at: Place) -> FloatArray:
    """Return EDGE_POINTS points on the target's edges in the world, (N, 2) um.

    They lie evenly along all edges, in the middle of as many equal lengths.
    """
    rings = outline_of(task, shape)
    only = target_ring(rings, shape)
    rings = rings if only is None else Outline(rings=(rings.rings[only],))
    posed = place(
        rings, target_at.pose.x_um, target_at.pose.y_um, target_at.pose.theta_rad
    )
    edges = [edge for ring in posed.rings for edge in ring.edges]
    ends = np.cumsum([edge.length_um for edge in edges])
    along = (np.arange(EDGE_POINTS) + 0.5) * ends[-1] / EDGE_POINTS
    starts = np.concatenate([[0.0], ends[:-1]])
    first = np.searchsorted(along, starts)
    last = np.append(first[1:], EDGE_POINTS)
    return np.vstack(
        [
            _points_on(edge, (along[i:j] - start) / edge.length_um)
            for edge, start, i, j in zip(edges, starts, first, last, strict=True)
            if j > i
        ]
    )


def _points_on(edge: Edge, share: FloatArray) -> FloatArray:
    """Return the points after `share` (0..1) of the length of an edge, (N, 2) um."""
    if isinstance(edge, Segment):
        start, end = np.array(edge.start), np.array(edge.end)
        points: FloatArray = start + share[:, None] * (end - start)
        return points
    angle = edge.start_rad + share * edge.sweep_rad
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.array(edge.center) + edge.radius_um * unit


def target_ring(outline: Outline, shape: TargetShape) -> int | None:
    """Return which ring of `outline_of` is the target; None: all of them."""
    if shape.kind != "circle":
        return shape.ring
    radius = shape.parameters["radius_um"]

    def misfit(ring_index: int) -> float:
        x0, y0, x1, y1 = Outline(rings=(outline.rings[ring_index],)).bounds_um
        return abs(max(x1, -x0) - radius) + abs(max(y1, -y0) - radius)

    return least(range(len(outline.rings)), misfit, scale=radius)
