"""Target shapes by name: kind, extent, parameters for the routines."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from microplan.arrays import Box
from microplan.featuresel.routines.contract import TargetKind
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.scene import Layer
from microplan.planner.assembly.assembly import (
    State,
    opened_fingers,
    part_pose,
)
from microplan.planner.task.regions.features import extent
from microplan.planner.task.surfaces import (
    OWN,
    Covering,
    Surface,
    marks_on,
    surfaces,
    without_marks,
)
from microplan.planner.task.task import FeatureKind, Part, PartFeature, Post, Task
from microplan.planner.task.workcell import Tool
from microplan.schemas.pose import Pose

ANGLE_SIGMAS = 3.0  # of an angle for which there must be room: trials end there
JAWS_SEEN_UM = 60.0  # of the fingers behind the grip that a look takes in


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetShape:
    """A target about its reference point, in the owner's axes but for `angle_rad`."""

    name: str  # as measured: the task's name, or "part.outline" for a whole part
    owner: str
    kind: TargetKind
    center_um: tuple[float, float]  # reference point in the owner's frame
    box_um: Box  # what must be in the field, about the reference point, as rotated
    finest_um: float  # smallest detail that a routine needs resolved
    bright: bool  # brighter than what surrounds it
    symmetry: int = 1
    symmetry_broken_by: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)
    angle_rad: float = 0.0  # of the target's own frame in the owner's
    body: str  # whose edges they are: part, part.post, part.mark, tool
    ring: int | None = None  # of a region: which ring of the body's; None: all

    @property
    def has_angle(self) -> bool:
        """Return whether a routine can measure the rotation, if within its period."""
        return self.symmetry != 0


def shape_of(task: Task, state: State, name: str) -> TargetShape | None:
    """Return the shape of a named target, None if no routine knows its kind."""
    owner, _, inner = name.partition(".")
    if owner in task.workcell.tools:
        rotation_rad = state.robot.theta_rad
        return _jaws(task.workcell.tools[owner], state.opening_um, rotation_rad)
    part = task.parts[owner]
    if inner in part.posts:
        return _post(part, part.posts[inner], name)
    if inner:
        feature = part.features[inner]
        if feature.kind == "notch":
            return None
        shape = declared_shape(part, feature, name)
        whole = feature.kind == "outline" and not feature.region
        return _as_turned(task, state, shape) if whole else shape
    teeth = next(_of_kind(part, "teeth", OWN), None)
    if teeth is not None:
        return _teeth(part, teeth, f"{owner}.{teeth.name}", surfaces(part)[OWN])
    return _as_turned(task, state, _whole(part))


def target_layers(task: Task, state: State, shape: TargetShape) -> tuple[Layer, ...]:
    """Return the owner's faces in the target's frame; heights are world heights at 0.

    Heights are relative to the owner's underside.
    """
    if shape.owner in task.workcell.tools:
        tool = task.workcell.tools[shape.owner]
        return tuple(
            Layer(
                name=name,
                outline=outline,
                z_um=tool.thickness_um,
                reflectance=tool.reflectance,
            )
            for name, outline in opened_fingers(tool, state.opening_um)
        )
    part = task.parts[shape.owner]
    dx, dy = -shape.center_um[0], -shape.center_um[1]
    found = list[Layer]()
    for face in surfaces(part).values():
        if face.name not in part.marks:
            found += face_layers(
                face.body(part.name),
                place(face.outline, dx, dy),
                face.z_um,
                face.reflectance,
                marks_on(part, face.name, (dx, dy, 0.0)),
            )
    return tuple(found)


def face_layers(
    name: str,
    outline: Outline,
    z_um: float,
    reflectance: float,
    marks: Sequence[Covering],
) -> tuple[Layer, ...]:
    """Return a top face and the marks on it, side by side at one height."""
    bare = without_marks(outline, [shape for _, shape, _ in marks])
    faces = [(name, bare, reflectance), *marks]
    return tuple(
        Layer(name=n, outline=shape, z_um=z_um, reflectance=r) for n, shape, r in faces
    )


def _disc(radius_um: float) -> Box:
    """Return the box of a disc, which holds at any angle."""
    return (-radius_um, -radius_um, radius_um, radius_um)


def _jaws(tool: Tool, opening_um: float, rotation_rad: float) -> TargetShape:
    """Return the jaws seen from the grip: both fingers from the tips on.

    The box is that of the fingers as the robot has rotated them.
    """
    half = opening_um / 2 + tool.finger_width_um
    turn = Pose(x_um=0.0, y_um=0.0, theta_rad=rotation_rad)
    corners = [
        turn.apply(x, y)
        for x in (-half, half)
        for y in (-tool.grip_from_tip_um, JAWS_SEEN_UM)
    ]
    xs, ys = zip(*corners, strict=True)
    return TargetShape(
        name=f"{tool.name}.grip",
        owner=tool.name,
        body=tool.name,
        kind="jaws",
        center_um=(0.0, 0.0),
        box_um=(min(xs), min(ys), max(xs), max(ys)),
        finest_um=min(tool.finger_width_um, opening_um),
        bright=True,
        parameters={
            "opening_um": opening_um,
            "finger_width_um": tool.finger_width_um,
            "grip_from_tip_um": tool.grip_from_tip_um,
        },
    )


def declared_shape(part: Part, feature: PartFeature, name: str) -> TargetShape:
    """Return a declared feature; a notch, no target of its own, as a circle."""
    face = surfaces(part)[feature.on]
    bright = face.bright != feature.hole
    if feature.kind == "teeth":
        return _teeth(part, feature, name, face)
    if feature.kind == "outline" and not feature.region:
        return _whole(part)
    if feature.kind == "outline":
        return _region(part, feature, name, face, bright=bright)
    return _circle(part, feature, name, face, bright=bright)


def _post(part: Part, post: Post, name: str) -> TargetShape:
    """Return a post's top face: a circle, or what it is drawn as."""
    face = surfaces(part)[post.name]
    if post.symmetry == 0:
        return _circle(part, post, name, face, bright=face.bright)
    return _region(part, post, name, face, bright=face.bright)


def _circle(
    part: Part, drawn: PartFeature | Post, name: str, face: Surface, *, bright: bool
) -> TargetShape:
    """Return the circle of a feature or of a post's top face."""
    return TargetShape(
        name=name,
        owner=part.name,
        body=face.body(part.name),
        kind="circle",
        center_um=drawn.center_um,
        box_um=_disc(drawn.radius_um),
        finest_um=2 * drawn.radius_um,
        bright=bright,
        symmetry=0,
        parameters={"radius_um": drawn.radius_um},
    )


def _region(
    part: Part, drawn: PartFeature | Post, name: str, face: Surface, *, bright: bool
) -> TargetShape:
    """Return a ring of a face, or the outline of a post, about its own point."""
    ring = drawn.ring if isinstance(drawn, PartFeature) else None
    rings = face.outline.rings if ring is None else (face.outline.rings[ring],)
    x0, y0, x1, y1 = Outline(rings=rings).bounds_um
    _, reach_um = extent(Outline(rings=rings), drawn.center_um)
    return TargetShape(
        name=name,
        owner=part.name,
        body=face.body(part.name),
        ring=ring,
        kind="outline",
        center_um=drawn.center_um,
        box_um=_disc(reach_um),
        finest_um=min(x1 - x0, y1 - y0),
        bright=bright,
        symmetry=drawn.symmetry,
        parameters={"extent_um": reach_um},
    )


def _teeth(part: Part, teeth: PartFeature, name: str, face: Surface) -> TargetShape:
    """Return a toothed rim, with the notch that breaks its symmetry if there is one."""
    parameters = {
        "count": float(teeth.count),
        "outer_um": teeth.radius_um,
        "root_um": teeth.root_um,
        "phase_rad": teeth.phase_rad,
    }
    finest = teeth.radius_um - teeth.root_um
    notch = next(_of_kind(part, "notch", teeth.on), None)
    bore = next((f for f in _of_kind(part, "circle", teeth.on) if f.hole), None)
    if notch is not None:
        parameters["notch_rad"] = notch.phase_rad
        parameters["notch_radius_um"] = notch.radius_um
        parameters["notch_width_um"] = notch.width_um
        finest = min(finest, notch.width_um)
    if bore is not None and math.dist(bore.center_um, teeth.center_um) < 1e-3:
        parameters["bore_um"] = bore.radius_um
    return TargetShape(
        name=name,
        owner=part.name,
        body=face.body(part.name),
        kind="teeth",
        center_um=teeth.center_um,
        box_um=_disc(teeth.radius_um),
        finest_um=finest,
        bright=face.bright,
        symmetry=teeth.count,
        symmetry_broken_by="" if notch is None else notch.name,
        parameters=parameters,
    )


def _of_kind(part: Part, kind: FeatureKind, on: str) -> Iterator[PartFeature]:
    """Yield the declared features of a kind and a face that may be looked for."""
    return (
        f
        for f in part.features.values()
        if f.kind == kind and f.on == on and not f.avoid
    )


def _whole(part: Part) -> TargetShape:
    """Return the whole outline, about the middle of its bounds."""
    x0, y0, x1, y1 = part.outline.bounds_um
    extent = math.hypot(x1 - x0, y1 - y0) / 2
    return TargetShape(
        name=f"{part.name}.outline",
        owner=part.name,
        body=part.name,
        kind="outline",
        center_um=middle_um(part),
        box_um=_disc(extent),
        finest_um=min(x1 - x0, y1 - y0),
        bright=True,
        parameters={"extent_um": extent},
    )


def _as_turned(task: Task, state: State, shape: TargetShape) -> TargetShape:
    """Return a whole outline with the box of all angles that it may have.

    Over an interval of 2 delta a corner's position is at most 1 - cos(delta / 2) of its
    distance beyond that at the ends or the middle.
    """
    part, held = task.parts[shape.owner], state.parts[shape.owner]
    known_rad = max(held.sigma_theta_rad, task.benchmark.pose_sigma_theta_rad)
    delta = ANGLE_SIGMAS * known_rad
    if delta >= math.pi / 4:
        return shape
    x0, y0, x1, y1 = part.outline.bounds_um
    theta, half_x, half_y = (
        part_pose(task, state, part.name).theta_rad, (x1 - x0) / 2, (y1 - y0) / 2,
    )  # fmt: skip
    more = math.hypot(half_x, half_y) * (1 - math.cos(delta / 2))
    rotations = [(abs(math.cos(t)), abs(math.sin(t)))
             for t in (theta - delta, theta, theta + delta)]  # fmt: skip
    x = max(c * half_x + s * half_y for c, s in rotations) + more
    y = max(s * half_x + c * half_y for c, s in rotations) + more
    return replace(shape, box_um=(-x, -y, x, y))


def middle_um(part: Part) -> tuple[float, float]:
    """Return the middle of a part's bounds, where its whole outline is measured."""
    x0, y0, x1, y1 = part.outline.bounds_um
    return ((x0 + x1) / 2, (y0 + y1) / 2)


def outline_of(task: Task, shape: TargetShape) -> Outline:
    """Return the outline that holds the target's edges, in the target's frame."""
    part = task.parts[shape.owner]
    outline = surface_of(part, shape).outline
    about = place(outline, -shape.center_um[0], -shape.center_um[1])
    return place(about, 0.0, 0.0, -shape.angle_rad) if shape.angle_rad else about


def target_edges(task: Task, shape: TargetShape) -> Outline:
    """Return what `outline_of` has of the target alone where it is a region."""
    found = outline_of(task, shape)
    return found if shape.ring is None else Outline(rings=(found.rings[shape.ring],))


def surface_of(part: Part, shape: TargetShape) -> Surface:
    """Return the face of a part that has a target's edges."""
    return surfaces(part)[shape.body.partition(".")[2]]
