"""The true state of the simulated cell: sizes, poses, axes with their errors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.devices.safety import AXES
from microplan.executor.simulated.outlines.containment import PoseAnswer
from microplan.executor.simulated.outlines.fabricated import (
    FabricatedRing,
    fabricated_ring,
)
from microplan.executor.simulated.shapes import (
    Fabricated,
    boundary,
    is_hole,
    made_post,
    polygons,
    ring_of,
)
from microplan.schemas.files.world import (
    World,
    WorldAxes,
    WorldHole,
    WorldPart,
    WorldPost,
    WorldTool,
)
from microplan.schemas.plan import AxesName
from microplan.schemas.pose import Pose


def made_truth(
    world: World, rng: Mapping[str, np.random.Generator], *, missing: bool
) -> Truth:
    """Return the world as it was made and laid out this time."""
    bodies = {}
    rims = rng["profile"].spawn(1)[0]  # moves nothing in the stream itself
    for part in world.parts:
        body = _body(part, rng, rims)
        if not (missing and not part.posts):
            bodies[part.name] = body
    tilt = world.stage_tilt_sigma_rad * rng["tilt"].standard_normal(2)
    angle = rng["drift"].uniform(0, 2 * math.pi)
    rate = world.stage_drift_um_per_min / 60
    truth = Truth(
        world=world,
        bodies=bodies,
        stage=_axis(world.stage, rng["stage"]),
        robot=_axis(world.robot, rng["robot"]),
        tool=world.tools[0] if world.tools else None,
        tilt=(float(tilt[0]), float(tilt[1])),
        drift_um_per_s=(rate * math.cos(angle), rate * math.sin(angle)),
        surfaces=_surfaces(world, rng["surface"]),
    )
    if truth.tool is not None:
        drawn = (truth.tool.left, truth.tool.right)
        truth.finger_rings = tuple(polygons(shape)[0] for shape in drawn)
        truth.tip_y_um = min(float(ring[:, 1].min()) for ring in truth.finger_rings)
        truth.opening_um = truth.tool.start_opening_um
    return truth


def _axis(spec: WorldAxes, rng: np.random.Generator) -> AxisState:
    """Return an axis group at its start, with a first landing error."""
    start = {name: float(getattr(spec.start, name) or 0.0) for name in AXES}
    draws = zip(AXES, repeatability(spec), rng.standard_normal(4), strict=True)
    error = {name: sigma * draw for name, sigma, draw in draws}
    actual = {k: v + error[k] for k, v in start.items()}
    return AxisState(spec=spec, commanded=start, error=error, actual=actual)


def repeatability(spec: WorldAxes) -> tuple[float, float, float, float]:
    """Return the standard deviation of landing of x, y, z (um) and theta (rad)."""
    xy_um, z_um = spec.repeatability_xy_um, spec.repeatability_z_um
    return (xy_um, xy_um, z_um, spec.repeatability_theta_rad)


def _body(
    part: WorldPart, rng: Mapping[str, np.random.Generator], rims: np.random.Generator
) -> TrueBody:
    """Return a part with its edge offsets, where it was laid down."""
    holes = _holes(part, rng["profile"], rims)
    dx, dy, turn = rng["start"].standard_normal(3)
    theta = part.start.theta_rad + part.sigma_theta_rad * turn
    anywhere = rng["start"].uniform(-math.pi, math.pi)
    made = {i: None if h is None else h.ring for i, h in holes.items()}
    drawn = [i for i, h in holes.items() if h is not None and h.offset_um == 0]
    shown = {i: ring for i, ring in made.items() if i not in drawn}  # arcs stay arcs
    rings = polygons(part.outline, made)
    edge = boundary(rings)
    return TrueBody(
        part=part,
        made=shown,
        holes=tuple(hole for hole in holes.values() if hole is not None),
        posts=tuple(_post(post, rng["profile"]) for post in part.posts),
        edge=edge,
        rings=rings,
        reach_um=float(np.hypot(*edge.T).max()),
        carrier="stage",
        z_um=0.0,
        pose=Pose(
            x_um=part.start.x_um + part.sigma_xy_um * dx,
            y_um=part.start.y_um + part.sigma_xy_um * dy,
            theta_rad=float(anywhere) if part.theta_any else theta,
        ),
    )


def _holes(
    part: WorldPart, rng: np.random.Generator, rims: np.random.Generator
) -> dict[int, TrueHole | None]:
    """Return every hole by its ring's number; None if its offset closed it.

    Named holes draw from `rng`, in order; all others from `rims`.
    """
    limit = part.profile_tolerance_um
    drawn = [(hole, float(rng.uniform(-limit, limit))) for hole in part.holes]
    named = {ring_of(hole, part.outline): (hole, off) for hole, off in drawn}
    found: dict[int, TrueHole | None] = {}
    for i, ring in enumerate(part.outline.rings):
        if not is_hole(ring):
            continue
        hole, offset_um = named.get(i) or (None, float(rims.uniform(-limit, limit)))
        made = fabricated_ring(ring.edges, offset_um, post=False)
        found[i] = None if made is None else _hole(hole, made, offset_um)
    return found


def _hole(hole: WorldHole | None, made: FabricatedRing, offset_um: float) -> TrueHole:
    """Return a hole; one that nothing names has the centre of its ring."""
    return TrueHole(
        name="" if hole is None else hole.name,
        center_um=made.center_um if hole is None else hole.center_um,
        offset_um=offset_um,
        ring=made,
    )


def _post(post: WorldPost, rng: np.random.Generator) -> TruePost:
    """Return a post with its edge offset."""
    limit = post.profile_tolerance_um
    offset_um = float(rng.uniform(-limit, limit))
    outermost, made = made_post(post, offset_um)
    ring = made[outermost]
    if ring is None:
        raise ValueError(f"{post.name} is thinner than its profile tolerance")
    return TruePost(
        name=post.name,
        made=made if offset_um else {},
        center_um=post.center_um,
        offset_um=offset_um,
        ring=ring,
        height_um=post.height_um,
        reflectance=post.reflectance,
        rings=polygons(post.outline, made),
        edge=boundary(polygons(post.outline, made)),
    )


def _surfaces(world: World, rng: np.random.Generator) -> dict[str, TrueSurface]:
    """Return how every body's walls and top face reflect, drawn from its intervals."""
    found = {}
    for part in world.parts:
        found[part.name] = _surface(part, rng)
        for post in part.posts:
            found[post.name] = _surface(post, rng)
    for tool in world.tools:
        found[tool.name] = _surface(tool, rng)
    return found


def _surface(
    body: WorldPart | WorldPost | WorldTool, rng: np.random.Generator
) -> TrueSurface:
    """Return one body's draw."""
    wall, finish = (rng.uniform(*ends) for ends in (body.wall_reflectance, body.finish))
    return TrueSurface(wall_reflectance=float(wall), finish=float(finish))


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueSurface:
    """How a body reflects."""

    wall_reflectance: float  # 0: black walls
    finish: float  # share of the top face's light that a mirror gives back


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueHole:
    """A hole as it was made, in its part's frame."""

    name: str  # as in the task; "" for a ring that nothing names
    center_um: tuple[float, float]  # as drawn
    offset_um: float  # of its edges, along their normals; positive: larger
    ring: FabricatedRing


@dataclass(slots=True, kw_only=True)
class TruePost:
    """A post as it was made, in its part's frame."""

    name: str
    made: Fabricated  # rings that are not as drawn
    center_um: tuple[float, float]  # as drawn
    offset_um: float  # of its edges, along their normals; positive: larger
    ring: FabricatedRing  # the outermost
    height_um: float
    reflectance: float
    edge: FloatArray  # boundary points
    rings: tuple[FloatArray, ...]


@dataclass(slots=True, kw_only=True)
class TrueBody:
    """A part as it was made, and where it truly is."""

    part: WorldPart
    made: Fabricated  # rings that are not as drawn
    holes: tuple[TrueHole, ...]
    posts: tuple[TruePost, ...]
    edge: FloatArray  # boundary points in the part's frame
    rings: tuple[FloatArray, ...]
    reach_um: float  # farthest boundary point from the origin
    carrier: AxesName
    pose: Pose  # in the carrier's frame
    z_um: float  # underside above the carrier: stage surface, or the fingers' underside
    on_posts: dict[str, int] = field(default_factory=dict)  # post to the hole it is in
    # the last ones about a post and a hole of it: they save time and change nothing
    answers: dict[tuple[str, int], PoseAnswer] = field(default_factory=dict)


@dataclass(slots=True, kw_only=True)
class AxisState:
    """State of an axis group: its commands, its errors, its true positions."""

    spec: WorldAxes
    commanded: dict[str, float]
    error: dict[str, float]
    actual: dict[str, float]


@dataclass(slots=True, kw_only=True)
class Truth:
    """True state of the cell, measured or not."""

    world: World
    bodies: dict[str, TrueBody]
    stage: AxisState
    robot: AxisState
    tool: WorldTool | None
    finger_rings: tuple[FloatArray, ...] = ()  # the same as polygons
    surfaces: Mapping[str, TrueSurface] = field(default_factory=dict)  # by body
    tip_y_um: float = 0.0  # of the fingers in the grip's frame
    opening_um: float = 0.0
    held: str = ""
    stuck: bool = False
    time_s: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)  # um sideways per um of stage z
    drift_um_per_s: tuple[float, float] = (0.0, 0.0)
    pushed_um: float = field(default=0.0)  # how far posts pushed held parts sideways
    collided: str = ""

    def hit(self, message: str) -> None:
        """Note the first collision."""
        self.collided = self.collided or message

    def stage_pose(self) -> Pose:
        """Return the true world pose of the stage's frame."""
        a, now = self.world.stage_theta_axis_um, self.stage.actual
        turn = Pose(x_um=0.0, y_um=0.0, theta_rad=now["theta_rad"])
        x_um, y_um = turn.apply(-a[0], -a[1])
        side = (self.tilt[0] * now["z_um"], self.tilt[1] * now["z_um"])
        drift = [v * self.time_s for v in self.drift_um_per_s]
        return Pose(
            x_um=now["x_um"] + a[0] + x_um + side[0] + drift[0],
            y_um=now["y_um"] + a[1] + y_um + side[1] + drift[1],
            theta_rad=now["theta_rad"],
        )

    def stage_z_um(self) -> float:
        """Return the world height of the stage's surface."""
        return self.world.stage_datum_z_um + self.stage.actual["z_um"]

    def grip_pose(self) -> Pose:
        """Return the true world pose of the grip.

        An error of the robot's angle swings the grip about the axis far behind it.
        """
        now, error_rad = self.robot.actual, self.robot.error["theta_rad"]
        lever_um = self.world.robot_theta_axis_to_tip_um + self.tip_y_um
        meant_rad = now["theta_rad"] - error_rad
        x0 = now["x_um"] - lever_um * math.sin(meant_rad)  # the axis
        y0 = now["y_um"] + lever_um * math.cos(meant_rad)
        return Pose(
            x_um=x0 + lever_um * math.sin(now["theta_rad"]),
            y_um=y0 - lever_um * math.cos(now["theta_rad"]),
            theta_rad=now["theta_rad"],
        )

    def grip_z_um(self) -> float:
        """Return the world height of the fingers' underside."""
        return self.robot.actual["z_um"]

    def carrier_pose(self, carrier: AxesName) -> Pose:
        """Return the world pose of a carrier's frame."""
        return self.stage_pose() if carrier == "stage" else self.grip_pose()

    def carrier_z_um(self, carrier: AxesName) -> float:
        """Return the world height that bodies' heights count from."""
        return self.stage_z_um() if carrier == "stage" else self.grip_z_um()

    def pose(self, body: TrueBody) -> Pose:
        """Return a body's true world pose."""
        return self.carrier_pose(body.carrier).compose(body.pose)

    def under_um(self, body: TrueBody) -> float:
        """Return the world height of a body's underside."""
        return self.carrier_z_um(body.carrier) + body.z_um

    def top_um(self, body: TrueBody) -> float:
        """Return the world height of a body's top face, posts left out."""
        return self.under_um(body) + body.part.thickness_um

    def post_top_um(self, host: TrueBody, post: TruePost) -> float:
        """Return the world height of the top of a post of `host`."""
        return self.top_um(host) + post.height_um

    def carry(
        self, body: TrueBody, carrier: AxesName, pose: Pose, under_um: float
    ) -> None:
        """Put a body, at a world pose and height, onto a carrier."""
        body.carrier = carrier
        body.pose = self.carrier_pose(carrier).inverse().compose(pose)
        body.z_um = under_um - self.carrier_z_um(carrier)
