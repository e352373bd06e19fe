"""A rig on a simulated cell, seen by a camera that draws the gear as a plain disc."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import cast

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.devices.drivers import Counts, Frame
from microplan.executor.motion.beliefs import Beliefs
from microplan.executor.record.frames import Frames
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.featuresel.routines.circle import circle_caliper
from microplan.featuresel.routines.contract import Artifact, LookModel, Target
from microplan.schemas.files.world import World
from microplan.schemas.plan import Belief, Look, Region, RoutineUse, View
from microplan.schemas.pose import Pose
from tests.executor.bench import NO_SCENE, measure, plan_of, quiet, untried, world

RADIUS_UM, SIDE, PITCH_UM = 20.0, 96, 1.0
REGION = Region(row=192, column=272, rows=SIDE, columns=SIDE)
CENTER = (320 - 0.5 - 272, 240 - 0.5 - 192)  # (column, row) of the world's origin


def disc(x_um: float, y_um: float) -> FloatArray:
    """Return a disc with an edge one pixel wide."""
    row, column = np.mgrid[0:SIDE, 0:SIDE]
    away = np.hypot(column - CENTER[0] - x_um, CENTER[1] - row - y_um)
    image: FloatArray = 0.2 + 0.6 * np.clip(RADIUS_UM - away + 0.5, 0.0, 1.0)
    return image


class PictureCamera:
    """A camera that shows what a function draws."""

    model, serial = "drawn", "0"

    def __init__(self, show: Callable[[Region | None], Counts]) -> None:
        self._show = show

    def grab(self, region: Region | None = None, *, after_s: float = 0.0) -> Frame:
        """Return the picture."""
        return Frame(counts=self._show(region), exposed_s=after_s)


def disc_camera(cell: Cell, *, mirror: bool = False) -> PictureCamera:
    """Return a camera that sees the gear's true place as a disc, mirrored if asked."""

    def show(region: Region | None) -> Counts:
        assert region == REGION
        pose = cell.truth.pose(cell.truth.bodies["gear"])
        image = disc(-pose.x_um if mirror else pose.x_um, pose.y_um)
        return np.rint(255 * image).astype(np.uint8)

    return PictureCamera(show)


@cache
def look() -> tuple[Look, Artifacts]:
    """Return a look at the disc, and its artifact."""

    def picture(
        *, dx_um: float = 0.0, dy_um: float = 0.0, theta_rad: float = 0.0
    ) -> FloatArray:
        return disc(dx_um, dy_um)

    target = Target(
        name="gear",
        kind="circle",
        column=CENTER[0],
        row=CENTER[1],
        theta_rad=0.0,
        px_per_um=1 / PITCH_UM,
        search_px=25.0,
        theta_range_rad=math.pi,
        symmetry=1,
        bright=True,
        parameters={"radius_um": RADIUS_UM},
    )
    artifact = circle_caliper.prepare(cast(LookModel, picture), target)
    assert isinstance(artifact, Artifact)
    use = RoutineUse(
        id="circle_caliper",
        version=circle_caliper.CIRCLE_CALIPER.version,
        parameters=artifact.parameters,
        arrays=None,
    )
    found = Look(
        id="disc",
        target="gear",
        view=View(
            magnification=7.5,
            focus_um=0.0,
            focus_stops_um=(),
            light=1.0,
            field_um=(640.0, 480.0),
            um_per_px=PITCH_UM,
        ),
        scene=NO_SCENE,
        effects=(),
        measure=measure((use,), REGION, CENTER, (0.0, 0.0), 60.0),
        evidence=untried(("circle_caliper",)),
    )
    return found, Artifacts({("disc", "circle_caliper"): artifact})


def quiet_cell() -> Cell:
    """Return a cell in which everything is as it should be."""
    return build_cell(noisy(0.0), 1)


@cache
def noisy(move_sigma_um: float) -> World:
    """Return a world whose only error is that of the stage's moves in x and y."""
    found = quiet(world())
    return replace(found, stage=replace(found.stage, repeatability_xy_um=move_sigma_um))


def rig_of(
    cell: Cell,
    artifacts: Artifacts,
    *,
    mirror: bool = False,
    camera: PictureCamera | None = None,
    probed: bool = True,
) -> Rig:
    """Return a rig that knows where the gear starts, with a goal at the origin.

    Unless told otherwise its zoom is set and its axes were probed before.
    """
    plan = plan_of(())
    goal = Belief(
        name="goal",
        carrier="robot",
        pose=Pose(x_um=0.0, y_um=-3000.0),  # the robot reads y = 3000
        sigma_xy_um=0.0,
        sigma_theta_rad=0.0,
    )
    eye = camera or disc_camera(cell, mirror=mirror)
    station, view = replace(cell.station, camera=eye), look()[0].view
    return Rig(
        view=view if probed else None,
        probed=view.magnification if probed else None,
        plan=plan,
        station=station,
        beliefs=Beliefs((*plan.beliefs, goal), plan.features),
        artifacts=artifacts,
        journal=Journal(io.StringIO(), station.clock),
        frames=Frames(None),
    )
