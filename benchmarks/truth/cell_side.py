"""Looks of an example as the simulated cell's camera would take them.

Outlines, heights and reflectances are those of world.json. Of the compiler come poses,
readings of the axes and the heights of undersides, which scenes.json keeps.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.truth.compiler_side import Surface
from microplan.executor.simulated.cameras.solid_pictures import SolidPictures, bodies_of
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.executor.simulated.gripper import stopped_um
from microplan.executor.simulated.hub import read_world
from microplan.executor.simulated.imaging.imaging_view import (
    ImagingView,
    LampLevel,
    PixelWindow,
)
from microplan.executor.simulated.imaging.solids.solid_scene import SolidScene
from microplan.executor.simulated.truth import AxisState
from microplan.schemas.codec import from_data
from microplan.schemas.files.evidence import LookScene, Scenes
from microplan.schemas.files.world import World, WorldAxes
from microplan.schemas.plan import AxisMove, Look

AXES = ("x_um", "y_um", "z_um", "theta_rad")


@dataclass(frozen=True, slots=True, kw_only=True)
class Photographed:
    """What the cell's camera sees at a look."""

    scene: SolidScene
    view: ImagingView
    window: PixelWindow  # the region of the frame that chains read


def flawless(world: World, surface: Surface) -> World:
    """Return a world without errors whose bodies all have one surface."""
    optics = replace(
        world.optics, scale_sigma=0.0, focus_repeatability_um=0.0, light_gradient=0.0,
        lens=replace(
            world.optics.lens, distortion_sigma=0.0, scale_sigma_per_um=0.0,
            field_curvature_sigma_per_um=0.0,
        ),
    )  # fmt: skip
    parts = tuple(
        replace(
            part,
            profile_tolerance_um=0.0,
            posts=tuple(replace(p, profile_tolerance_um=0.0) for p in part.posts),
        )
        for part in world.parts
    )
    return at_rest(with_surface(replace(world, optics=optics, parts=parts), surface))


def with_surface(world: World, surface: Surface) -> World:
    """Return a world whose bodies all have one surface."""
    wall = (surface.wall, surface.wall)
    finish = (surface.finish, surface.finish)
    parts = tuple(
        replace(
            part,
            wall_reflectance=wall,
            finish=finish,
            posts=tuple(
                replace(post, wall_reflectance=wall, finish=finish)
                for post in part.posts
            ),
        )
        for part in world.parts
    )
    tools = tuple(
        replace(tool, wall_reflectance=wall, finish=finish) for tool in world.tools
    )
    return replace(world, parts=parts, tools=tools)


def at_rest(world: World) -> World:
    """Return a world whose axes land where they are sent and whose image stays."""
    return replace(
        world, stage=_exact(world.stage), robot=_exact(world.robot),
        stage_tilt_sigma_rad=0.0, stage_drift_um_per_min=0.0,
        optics=replace(
            world.optics, parcentric_sigma_um=0.0, lateral_sigma_um_per_um=0.0
        ),
        parts=tuple(
            replace(part, sigma_xy_um=0.0, sigma_theta_rad=0.0, theta_any=False)
            for part in world.parts
        ),
    )  # fmt: skip


def as_tried(world: World) -> World:
    """Return a world in which nothing errs that a look's trials leave to the budget."""
    lens = replace(world.optics.lens, distortion_sigma=0.0, scale_sigma_per_um=0.0)
    optics = replace(world.optics, lens=lens)
    return at_rest(replace(world, optics=optics))


def _exact(axes: WorldAxes) -> WorldAxes:
    """Return axes that land where they are sent."""
    return replace(
        axes, repeatability_xy_um=0.0, repeatability_z_um=0.0,
        repeatability_theta_rad=0.0,
    )  # fmt: skip


def scenes_of(plan_file: Path) -> Mapping[str, LookScene]:
    """Return where everything is at each look of a plan, by the look's id."""
    text = plan_file.with_name("scenes.json").read_text(encoding="utf-8")
    return {each.look: each for each in from_data(Scenes, json.loads(text)).looks}


def photographed(
    plan_file: Path, look: Look, placed: LookScene, surface: Surface
) -> Photographed:
    """Return a look's scene and view on the cell, with nothing off."""
    world = read_world(plan_file.with_name("world.json"))
    cell = build_cell(flawless(world, surface), 0)
    put(cell, placed)
    view, region = look.view, look.measure.region
    cell.lens.set_magnification(view.magnification)
    cell.lens.set_focus_um(view.focus_um)
    return Photographed(
        scene=bodies_of(cell.truth),
        view=SolidPictures(cell.truth, cell.lens).view(
            LampLevel(level=view.light), height_px=cell.truth.world.optics.height_px
        ),
        window=PixelWindow(
            row=region.row, column=region.column, rows=region.rows,
            columns=region.columns,
        ),
    )  # fmt: skip


def put(cell: Cell, placed: LookScene) -> None:
    """Put a cell's axes and bodies where they are at a look."""
    truth = cell.truth
    _read(truth.stage, placed.stage)
    if placed.robot is not None:
        _read(truth.robot, placed.robot)
    for there in placed.bodies:
        body = truth.bodies.get(there.name)
        if body is not None:
            under_um = there.z_um - body.part.thickness_um
            truth.carry(body, "stage", there.pose, under_um)
    if placed.opening_um is not None:
        truth.opening_um = stopped_um(truth, placed.opening_um)


def _read(axes: AxisState, at: AxisMove) -> None:
    """Bring axes to readings."""
    for name in AXES:
        value = getattr(at, name)
        if value is not None:
            axes.actual[name] = axes.commanded[name] = value
