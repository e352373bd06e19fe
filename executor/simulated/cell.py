"""Build a simulated cell from world.json, and judge what truly became of the parts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from executor.safety import Rules, Safety, Settle, Speeds
from executor.simulated.axes import Drive, SimAxes
from executor.simulated.camera import SimCamera, SimLens, SimLight, drawn_errors
from executor.simulated.contact import hole_error
from executor.simulated.faults import Faults
from executor.simulated.gripper import SimGripper
from executor.simulated.shapes import (
    boundary,
    made_post,
    outline_of,
    polygons,
    with_holes,
)
from executor.simulated.timeline import SimClock, Timeline, Trouble
from executor.simulated.truth import AxisState, Body, Post, Truth
from executor.station import Offer, Station
from schemas.pose import Pose
from schemas.world import World, WorldAxes, WorldPart, WorldPost

# Each purpose has its own stream, so that one more draw here moves nothing there.
PURPOSES = (
    "start", "profile", "tilt", "lateral", "drift",
    "zoom", "focus", "stage", "robot", "light", "noise", "stick", "lens",
)  # fmt: skip

POLL_S = 0.05  # of the cell's own time
SEATED_UM = 1.0  # a part lying this close to its seat lies on it


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What truly became of a part that was to be put onto a post, or beside a mark."""

    success: bool
    offset_um: float  # from the seat's centre to what belongs there
    height_um: float  # of the underside above the seat
    collided: str  # the first collision, "" if there was none
    held: bool  # the tool still carries it


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A simulated cell: its truth, and the station that works on it."""

    truth: Truth
    station: Station
    stage: SimAxes
    robot: SimAxes
    jaws: SimGripper
    lens: SimLens
    light: SimLight
    camera: SimCamera
    clock: SimClock
    faults: Faults
    timeline: Timeline

    def judge(self, target: str, on: str, within_um: float = 0.0) -> Verdict:
        """Return whether the part of `target` truly sits on `on`.

        By true pose and height: the underside on the face of the seat's part, the tool
        has let go, and the hole is around the post; where the seat is a round hole, the
        target's own place is within `within_um` of its middle.

        Raises
        ------
        ValueError
            If there is no such part, post or hole.
        """
        return judge(self.truth, target, on, within_um)

    def shown_um(self, owner: str, x_um: float, y_um: float) -> tuple[float, float]:
        """Return where a point of a part, or of the tool's grip, is truly shown now.

        The lens' own sideways shift is in it: all looks share it, and what they differ
        by has its own rows in the plan's budget. Its distortion is not.

        Raises
        ------
        ValueError
            If the cell has nothing of that name.
        """
        truth, (dx, dy) = self.truth, self.lens.shift_um
        if owner in truth.bodies:
            x, y = truth.pose(truth.bodies[owner]).apply(x_um, y_um)
        elif truth.tool is not None and truth.tool.name == owner:
            x, y = truth.grip_pose().apply(x_um, y_um)
        else:
            raise ValueError(f"the cell has no {owner!r}")
        return (x + dx, y + dy)


def build_cell(
    world: World,
    seed: int,
    faults: Iterable[str] = (),
    *,
    drives: Mapping[str, Drive] | None = None,
) -> Cell:
    """Return a cell whose errors are drawn from `seed`.

    Parameters
    ----------
    world : World
        What `world.json` describes.
    seed : int
        Root of all the cell's random numbers.
    faults : iterable of str
        Names of `executor.simulated.faults.FAULTS`, or NAME@STEP.
    drives : mapping of str to Drive
        By "stage" and "robot"; a drive that is left out is where it reads.
    """
    rng, made = _generators(seed), drives or {}
    wrong = Faults(faults)
    truth = _truth(world, rng, missing=wrong.on("no_part"))
    timeline = Timeline(truth)
    stage, robot = (
        SimAxes(
            timeline, name, state, rng[name], Trouble(wrong, "axis"),
            drive=made.get(name),
        )
        for name, state in (("stage", truth.stage), ("robot", truth.robot))
    )  # fmt: skip
    lens = _lens(timeline, rng, wrong)
    light = SimLight(world.optics, rng["light"], wrong)
    clock = SimClock(timeline)
    camera = SimCamera(timeline, lens, light, rng["noise"], wrong)
    stick = 0.0 if truth.tool is None else truth.tool.stick_probability
    stick = 1.0 if wrong.on("stick") else stick
    jaws = SimGripper(timeline, rng["stick"], Trouble(wrong, "jaws"), stick=stick)
    station = Station(
        stage=stage,
        robot=robot,
        gripper=None if truth.tool is None else jaws,
        lens=lens,
        light=light,
        camera=camera,
        clock=clock,
        offer=offer_of(world),
        rules=rules_of(world),
    )
    return Cell(
        truth=truth, station=station, stage=stage, robot=robot, jaws=jaws, lens=lens,
        light=light, camera=camera, clock=clock, faults=wrong, timeline=timeline,
    )  # fmt: skip


def _lens(
    timeline: Timeline, rng: Mapping[str, np.random.Generator], faults: Faults
) -> SimLens:
    """Return the lens, with its errors of this run."""
    optics = timeline.truth.world.optics
    lateral = optics.lateral_sigma_um_per_um * rng["lateral"].standard_normal(2)
    return SimLens(
        timeline,
        (rng["zoom"], rng["focus"]),
        (lateral[0], lateral[1]),
        drawn_errors(optics.lens, rng["lens"]),
        Trouble(faults, "lens"),
    )


def judge(truth: Truth, target: str, on: str, within_um: float = 0.0) -> Verdict:
    """Return what became of a part; see `Cell.judge`."""
    body = truth.bodies.get(target.partition(".")[0])
    host = truth.bodies.get(on.partition(".")[0])
    if body is None or host is None:
        raise ValueError(f"the cell has no part {target!r} or {on!r}")
    offset_um, room_um = _off_seat(truth, target, body, on, host, within_um)
    height_um = truth.under_um(body) - truth.top_um(host)
    held = truth.held == body.part.name
    seated = offset_um <= room_um + 1e-6 and abs(height_um) <= SEATED_UM
    return Verdict(
        success=bool(seated and not held and not truth.collided),
        offset_um=offset_um,
        height_um=float(height_um),
        collided=truth.collided,
        held=held,
    )


def _off_seat(
    truth: Truth, target: str, body: Body, on: str, host: Body, within_um: float
) -> tuple[float, float]:
    """Return how far the target truly is off its seat, and how far it may be, um."""
    for post in host.posts:
        if post.name == on:
            error = hole_error(truth, body, host, post)
            if error is None:
                raise ValueError(f"{target!r} has no hole")
            return math.hypot(error[0], error[1]), error[2]
    x, y = truth.pose(body).apply(*_point(body, target))
    seat_x, seat_y = truth.pose(host).apply(*_point(host, on))
    return math.hypot(x - seat_x, y - seat_y), within_um


def _point(body: Body, name: str) -> tuple[float, float]:
    """Return a hole's centre in its part's frame; a part's own place is its origin."""
    if name == body.part.name:
        return (0.0, 0.0)
    for hole in body.part.holes:
        if hole.name == name:
            return hole.center_um
    raise ValueError(f"the cell has no post and no hole {name!r}")


def offer_of(world: World) -> Offer:
    """Return what the simulated devices can do."""
    optics = world.optics
    travel = {
        f"{name}.{axis}": limits
        for name, axes in (("stage", world.stage), ("robot", world.robot))
        for axis, limits in axes.limits.items()
    }
    return Offer(
        width_px=optics.width_px,
        height_px=optics.height_px,
        pitch_um=optics.pitch_um,
        bits=optics.bits,
        magnification=optics.magnification,
        focus_um=optics.focus_um,
        opening_um=world.tools[0].opening_um if world.tools else None,
        travel=travel,
        theta_axis_um=world.stage_theta_axis_um,
    )


def rules_of(world: World) -> Rules:
    """Return how the simulated axes settle and what they may do."""
    return Rules(
        stage=_settle(world.stage),
        robot=_settle(world.robot),
        stage_datum_z_um=world.stage_datum_z_um,
        stage_speeds=_speeds(world.stage),
        robot_speeds=_speeds(world.robot),
        safety=Safety(poll_s=POLL_S),
    )


def _settle(axes: WorldAxes) -> Settle:
    """Return the dwell that the workcell states; the readings are the commands."""
    return Settle(dwell_s=axes.settle_s)


def _speeds(axes: WorldAxes) -> Speeds:
    """Return the axes' own speeds."""
    return Speeds(
        xy_um_per_s=axes.speed_xy_um_per_s,
        z_um_per_s=axes.speed_z_um_per_s,
        theta_rad_per_s=axes.speed_theta_rad_per_s,
    )


def _generators(seed: int) -> Mapping[str, np.random.Generator]:
    """Return one stream of random numbers per purpose."""
    return {
        purpose: np.random.default_rng(np.random.SeedSequence([seed, number]))
        for number, purpose in enumerate(PURPOSES)
    }


def _truth(
    world: World, rng: Mapping[str, np.random.Generator], *, missing: bool
) -> Truth:
    """Return the world as it was made and laid out this time."""
    bodies = {}
    for part in world.parts:
        body = _body(part, rng)
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
    )
    _add_fingers(truth)
    return truth


def _axis(spec: WorldAxes, rng: np.random.Generator) -> AxisState:
    """Return an axis group at its start, where it stands with an error already."""
    state = AxisState.at_start(spec)
    x, y, z, theta = rng.standard_normal(4)
    state.error = {
        "x_um": spec.repeatability_xy_um * x,
        "y_um": spec.repeatability_xy_um * y,
        "z_um": spec.repeatability_z_um * z,
        "theta_rad": spec.repeatability_theta_rad * theta,
    }
    state.actual = {k: v + state.error[k] for k, v in state.commanded.items()}
    return state


def _add_fingers(truth: Truth) -> None:
    """Give the truth its fingers, if there is a tool."""
    tool = truth.tool
    if tool is None:
        return
    truth.fingers = (outline_of(tool.left), outline_of(tool.right))
    truth.finger_rings = tuple(polygons(o)[0] for o in truth.fingers)
    truth.tip_y_um = min(float(ring[:, 1].min()) for ring in truth.finger_rings)
    truth.opening_um = tool.start_opening_um


def _body(part: WorldPart, rng: Mapping[str, np.random.Generator]) -> Body:
    """Return a part with its edge offsets, where it was laid down."""
    limit = part.profile_tolerance_um
    made = [(h, float(rng["profile"].uniform(-limit, limit))) for h in part.holes]
    dx, dy, turn = rng["start"].standard_normal(3)
    theta = part.start.theta_rad + part.sigma_theta_rad * turn
    anywhere = rng["start"].uniform(-math.pi, math.pi)
    return Body.made(
        part,
        with_holes(outline_of(part.outline), made),
        {hole.name: hole.radius_um + offset for hole, offset in made},
        tuple(_post(post, rng["profile"]) for post in part.posts),
        Pose(
            x_um=part.start.x_um + part.sigma_xy_um * dx,
            y_um=part.start.y_um + part.sigma_xy_um * dy,
            theta_rad=float(anywhere) if part.theta_any else theta,
        ),
    )


def _post(post: WorldPost, rng: np.random.Generator) -> Post:
    """Return a post with its edge offset."""
    limit = post.profile_tolerance_um
    offset_um = float(rng.uniform(-limit, limit))
    outline = made_post(post, offset_um)
    return Post(
        name=post.name,
        outline=outline,
        center_um=post.center_um,
        radius_um=post.radius_um + offset_um,
        height_um=post.height_um,
        reflectance=post.reflectance,
        edge=boundary(outline),
        rings=polygons(outline),
    )
