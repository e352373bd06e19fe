"""The simulated cell as it was made and laid out: sizes, poses and errors drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from microplan.executor.simulated.shapes import (
    boundary,
    made_post,
    outline_of,
    polygons,
    with_holes,
)
from microplan.executor.simulated.truth import AxisState, TrueBody, TruePost, Truth
from microplan.schemas.files.world import World, WorldAxes, WorldPart, WorldPost
from microplan.schemas.pose import Pose


def made_truth(
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


def _body(part: WorldPart, rng: Mapping[str, np.random.Generator]) -> TrueBody:
    """Return a part with its edge offsets, where it was laid down."""
    limit = part.profile_tolerance_um
    made = [(h, float(rng["profile"].uniform(-limit, limit))) for h in part.holes]
    dx, dy, turn = rng["start"].standard_normal(3)
    theta = part.start.theta_rad + part.sigma_theta_rad * turn
    anywhere = rng["start"].uniform(-math.pi, math.pi)
    return TrueBody.made(
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


def _post(post: WorldPost, rng: np.random.Generator) -> TruePost:
    """Return a post with its edge offset."""
    limit = post.profile_tolerance_um
    offset_um = float(rng.uniform(-limit, limit))
    outline = made_post(post, offset_um)
    return TruePost(
        name=post.name,
        outline=outline,
        center_um=post.center_um,
        radius_um=post.radius_um + offset_um,
        height_um=post.height_um,
        reflectance=post.reflectance,
        edge=boundary(outline),
        rings=polygons(outline),
    )
