"""A small plan and world for the gear-on-shaft job, built by hand from the drawings."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import cast

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import (
    Artifact,
    LookModel,
    Target,
    TargetKind,
)
from microplan.featuresel.routines.picture import RegionFrame
from microplan.featuresel.routines.registry import load
from microplan.optics.outline.outline import Arc, Outline, place
from microplan.optics.render.render import render
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.assembly.world import finger_solids, part_solids
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from microplan.schemas.codec import to_data
from microplan.schemas.files.world import (
    World,
    WorldAxes,
    WorldHole,
    WorldOptics,
    WorldOutline,
    WorldPart,
    WorldPost,
    WorldRing,
    WorldTool,
)
from microplan.schemas.plan import (
    FORMAT_VERSION,
    Action,
    AlignAction,
    AxisMove,
    Belief,
    Budget,
    Conditions,
    Control,
    Evidence,
    FeaturePlace,
    Gates,
    GraspAction,
    HeightSearch,
    InsertAction,
    LocateAction,
    Look,
    Measure,
    MoveAction,
    Plan,
    Provenance,
    Reference,
    Region,
    ReleaseAction,
    Requirements,
    RoutineUse,
    SceneRecord,
    Score,
    Step,
    VerifyAction,
    View,
    dump_plan,
)
from microplan.schemas.plan.views import Fingers, Solid
from microplan.schemas.pose import Pose

EXAMPLE = Path(__file__).parents[2] / "examples" / "gear_on_shaft" / "task.yaml"
SIDE = 200  # px of a look's region
MAGNIFICATION = 6.9
NO_SCENE = SceneRecord(layers=(), shades=(), image="", image_sha256="")
# the simulated cell, seen by its quick camera
QUICK = ("--station", "sim", "--camera", "quick")


@cache
def task() -> Task:
    """Return the example, read."""
    report = Report()
    found = load_task(EXAMPLE, report)
    assert found is not None, report.found
    return found


def world_outline(outline: Outline) -> WorldOutline:
    """Return an outline as numbers."""
    rings = []
    for ring in outline.rings:
        edges = tuple(
            (*e.center, e.radius_um, e.start_rad, e.sweep_rad)
            if isinstance(e, Arc)
            else (*e.start, *e.end)
            for e in ring.edges
        )
        rings.append(WorldRing(layer=ring.layer, edges=edges))
    return WorldOutline(rings=tuple(rings))


def world() -> World:
    """Return the example's workcell and parts as a world."""
    cell = task().workcell
    tool = cell.tools["tweezers"]
    start = task().tool_starts["tweezers"]
    parts = []
    for name, part in task().parts.items():
        pose = task().part_starts[name]
        holes = [f for f in part.features.values() if f.kind == "circle" and f.hole]
        parts.append(
            WorldPart(
                name=name,
                outline=world_outline(part.outline),
                thickness_um=part.thickness_um,
                reflectance=part.reflectance,
                profile_tolerance_um=part.profile_tolerance_um,
                posts=tuple(
                    WorldPost(
                        name=f"{name}.{post.name}",
                        outline=world_outline(post.outline),
                        height_um=post.height_um,
                        reflectance=post.reflectance,
                        center_um=post.center_um,
                        radius_um=post.radius_um,
                        profile_tolerance_um=post.profile_tolerance_um,
                    )
                    for post in part.posts.values()
                ),
                holes=tuple(
                    WorldHole(
                        name=f"{name}.{f.name}",
                        center_um=f.center_um,
                        radius_um=f.radius_um,
                    )
                    for f in holes
                ),
                start=Pose(x_um=pose.x_um, y_um=pose.y_um, theta_rad=pose.theta_rad),
                theta_any=pose.theta_any,
                sigma_xy_um=pose.sigma_xy_um,
                sigma_theta_rad=pose.sigma_theta_rad,
            )
        )
    return World(
        name=cell.name,
        optics=_world_optics(),
        stage=_world_axes("stage"),
        stage_datum_z_um=cell.stage.datum_z_um,
        stage_reflectance=cell.stage.reflectance,
        stage_theta_axis_um=cell.stage.theta_axis_um,
        stage_tilt_sigma_rad=cell.stage.axis_tilt_sigma_rad,
        stage_drift_um_per_min=cell.stage.drift_um_per_min,
        robot=_world_axes("robot"),
        robot_theta_axis_to_tip_um=cell.robot.theta_axis_to_tip_um,
        parts=tuple(parts),
        tools=(
            WorldTool(
                name="tweezers",
                left=world_outline(tool.left),
                right=world_outline(tool.right),
                thickness_um=tool.thickness_um,
                reflectance=tool.reflectance,
                opening_um=tool.opening_um,
                start_opening_um=start.opening_um,
                stick_probability=tool.stick_probability,
            ),
        ),
    )


def quiet(found: World) -> World:
    """Return a world in which everything is as nominal: no spread, no tolerance."""
    return replace(
        found,
        stage=exact(found.stage),
        robot=exact(found.robot),
        stage_tilt_sigma_rad=0.0,
        stage_drift_um_per_min=0.0,
        optics=replace(
            found.optics,
            parcentric_sigma_um=0.0,
            scale_sigma=0.0,
            focus_repeatability_um=0.0,
            lateral_sigma_um_per_um=0.0,
            light_gradient=0.0,
        ),
        parts=tuple(
            replace(
                p,
                sigma_xy_um=0.0,
                sigma_theta_rad=0.0,
                theta_any=False,
                profile_tolerance_um=0.0,
                posts=tuple(replace(q, profile_tolerance_um=0.0) for q in p.posts),
            )
            for p in found.parts
        ),
    )


def exact(axes: WorldAxes) -> WorldAxes:
    """Return axes that land where they are sent."""
    return replace(
        axes,
        repeatability_xy_um=0.0,
        repeatability_z_um=0.0,
        repeatability_theta_rad=0.0,
    )


def _world_optics() -> WorldOptics:
    """Return the example's optics as the world has them."""
    cell = task().workcell
    optics, camera = cell.optics, cell.camera
    return WorldOptics(
        magnification=optics.magnification,
        apertures=optics.apertures,
        wavelength_um=optics.wavelength_um,
        medium_index=optics.medium_index,
        pitch_um=camera.pitch_um,
        width_px=camera.width_px,
        height_px=camera.height_px,
        fill_factor=camera.fill_factor,
        bits=camera.bits,
        full_well_e=camera.full_well_e,
        read_noise_e=camera.read_noise_e,
        zoom_time_s=optics.zoom.time_s,
        parcentric_sigma_um=optics.zoom.parcentric_sigma_um,
        scale_sigma=optics.zoom.scale_sigma,
        focus_um=(optics.focus.min_um, optics.focus.max_um),
        focus_time_s=optics.focus.time_s,
        focus_repeatability_um=optics.focus.repeatability_um,
        lateral_sigma_um_per_um=optics.focus.lateral_sigma_um_per_um,
        frame_time_s=1 / camera.rate_hz,
        light=cell.light.level,
        light_gradient=cell.light.gradient,
    )


def _world_axes(name: str) -> WorldAxes:
    """Return the stage's or the robot's axes."""
    cell = task().workcell
    axes = cell.stage.axes if name == "stage" else cell.robot.axes
    return WorldAxes(
        start=stage_start() if name == "stage" else robot_start(),
        repeatability_xy_um=axes.repeatability_xy_um,
        repeatability_z_um=axes.repeatability_z_um,
        repeatability_theta_rad=axes.repeatability_theta_rad,
        limits=axes.limits,
        speed_xy_um_per_s=axes.speed_xy_um_per_s,
        speed_z_um_per_s=axes.speed_z_um_per_s,
        speed_theta_rad_per_s=axes.speed_theta_rad_per_s,
        settle_s=axes.settle_s,
    )


def stage_start() -> AxisMove:
    """Return the stage's start reading."""
    return AxisMove(axes="stage", x_um=-600.0, y_um=0.0, z_um=0.0, theta_rad=0.0)


def robot_start() -> AxisMove:
    """Return the robot's start reading."""
    return AxisMove(axes="robot", x_um=0.0, y_um=3000.0, z_um=400.0, theta_rad=0.0)


@dataclass(frozen=True, kw_only=True)
class Seen:
    """A nominal scene: where the gear and the plate are and how far the jaws gape."""

    gear: tuple[float, float, float]  # x, y, height of the underside
    plate: tuple[float, float, float]
    opening_um: float | None  # None: the fingers are away

    def scene(self, move: str, dx_um: float, dy_um: float) -> Scene:
        """Return the layers; the body called `move` is displaced."""
        at = {"gear": self.gear, "shaft_plate": self.plate}
        layers = []
        for name, (x, y, z) in at.items():
            part = task().parts[name]
            if name == move:
                x, y = x + dx_um, y + dy_um
            top = z + part.thickness_um
            layers.append(
                Layer(
                    name=name,
                    outline=place(part.outline, x, y),
                    z_um=top,
                    reflectance=part.reflectance,
                )
            )
            layers += [
                Layer(
                    name=post.name,
                    outline=place(post.outline, x, y),
                    z_um=top + post.height_um,
                    reflectance=post.reflectance,
                )
                for post in part.posts.values()
            ]
        return Scene(layers=(*layers, *self._fingers()), background=0.1)

    def _fingers(self) -> list[Layer]:
        """Return the fingers' tops, if they are there."""
        if self.opening_um is None:
            return []
        tool, half = task().workcell.tools["tweezers"], self.opening_um / 2
        return [
            Layer(name=n, outline=place(o, s * half, 0.0), z_um=230.0, reflectance=0.7)
            for n, o, s in (("left", tool.left, -1), ("right", tool.right, 1))
        ]


class Folder:
    """Collects looks and their arrays, and writes the plan folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "artifacts").mkdir(parents=True)

    def look(
        self,
        look_id: str,
        target: str,
        seen: Seen,
        *,
        at: tuple[float, float] = (0.0, 0.0),
        focus_um: float,
        radius_um: float = 25.0,
        max_shift_um: float = 60.0,
        chain: Sequence[str] = ("circle_caliper",),
    ) -> Look:
        """Return a look at a circle, its artifacts prepared and written."""
        microscope = microscope_at(MAGNIFICATION)
        region = region_about(*at)
        frame = RegionFrame(
            width_px=640,
            height_px=480,
            um_per_px=microscope.um_per_px,
            row=region.row,
            column=region.column,
        )
        column, row = frame.to_pixel(*at)
        body = target.partition(".")[0]
        teeth = "tooth_notch" in chain
        kind: TargetKind = "teeth" if teeth else "circle"

        def picture(
            *, dx_um: float = 0.0, dy_um: float = 0.0, theta_rad: float = 0.0
        ) -> FloatArray:
            return render(
                seen.scene(body, dx_um, dy_um),
                microscope,
                focus_um=focus_um,
                window=Window(
                    row=region.row,
                    column=region.column,
                    rows=region.rows,
                    columns=region.columns,
                ),
            )

        wanted = Target(
            name=target,
            kind=kind,
            column=column,
            row=row,
            theta_rad=0.0,
            px_per_um=microscope.px_per_um,
            search_px=45.0,
            theta_range_rad=math.pi,
            symmetry=1,
            bright="post" in target,
            parameters=gear_teeth() if teeth else {"radius_um": radius_um},
        )
        uses = []
        for name in chain:
            # these routines ask for the picture alone
            artifact = load(name).prepare(cast(LookModel, picture), wanted)
            assert isinstance(artifact, Artifact), (look_id, artifact)
            uses.append(self._use(look_id, name, artifact))
        return Look(
            id=look_id,
            target=target,
            view=View(
                magnification=MAGNIFICATION,
                focus_um=focus_um,
                focus_stops_um=(),
                light=1.0,
                field_um=microscope.field_um,
                um_per_px=microscope.um_per_px,
            ),
            scene=NO_SCENE,
            effects=(),
            measure=measure(tuple(uses), region, (column, row), at, max_shift_um),
            evidence=untried(chain),
        )

    def _use(self, look_id: str, name: str, artifact: Artifact) -> RoutineUse:
        """Write a routine's arrays and return its use."""
        path = None
        if artifact.arrays:
            path = f"artifacts/{look_id}_{name}.npz"
            np.savez(self.folder / path, **dict(artifact.arrays))  # type: ignore[arg-type]  # numpy's stub
        return RoutineUse(
            id=name,
            version=load(name).version,
            parameters=artifact.parameters,
            arrays=path,
        )

    def write(self, plan: Plan, found: World) -> Path:
        """Write plan.json and world.json; return the plan's path."""
        path = self.folder / "plan.json"
        path.write_text(dump_plan(plan), encoding="utf-8")
        text = json.dumps(to_data(found))
        (self.folder / "world.json").write_text(text, encoding="utf-8")
        return path


def gear_teeth() -> dict[str, float]:
    """Return what is known of the gear's teeth, bore and notch."""
    features = task().parts["gear"].features
    teeth, notch, bore = (features[name] for name in ("teeth", "notch", "bore"))
    return {
        "count": teeth.count,
        "outer_um": teeth.radius_um,
        "root_um": teeth.root_um,
        "phase_rad": teeth.phase_rad,
        "notch_rad": notch.phase_rad,
        "notch_radius_um": notch.radius_um,
        "notch_width_um": notch.width_um,
        "bore_um": bore.radius_um,
    }


def microscope_at(magnification: float) -> Microscope:
    """Return the example's microscope."""
    optics, camera = task().workcell.optics, task().workcell.camera
    return Microscope(
        aperture=optics.aperture(magnification),
        wavelength_um=optics.wavelength_um,
        medium_index=optics.medium_index,
        magnification=magnification,
        pitch_um=camera.pitch_um,
        width_px=camera.width_px,
        height_px=camera.height_px,
        fill_factor=camera.fill_factor,
    )


def region_about(x_um: float, y_um: float) -> Region:
    """Return the region of SIDE x SIDE px about a point, inside the frame."""
    frame = RegionFrame(
        width_px=640, height_px=480, um_per_px=microscope_at(MAGNIFICATION).um_per_px
    )
    column, row = frame.to_pixel(x_um, y_um)
    return Region(
        row=min(max(round(row) - SIDE // 2, 0), 480 - SIDE),
        column=min(max(round(column) - SIDE // 2, 0), 640 - SIDE),
        rows=SIDE,
        columns=SIDE,
    )


def measure(
    uses: tuple[RoutineUse, ...],
    region: Region,
    pixel: tuple[float, float],
    at: tuple[float, float],
    max_shift_um: float,
) -> Measure:
    """Return how a look measures."""
    return Measure(
        chain=uses,
        fallback=(),
        region=region,
        reference=Reference(
            column=pixel[0],
            row=pixel[1],
            pose=Pose(x_um=at[0], y_um=at[1]),
            z_um=0.0,
        ),
        bias_um=(0.0, 0.0),
        jacobian_px_per_um=(),
        sigma_xy_um=0.1,
        sigma_theta_rad=0.01 if any(u.id == "tooth_notch" for u in uses) else None,
        limit_xy_um=None,
        gates=Gates(min_score=0.3, max_shift_um=max_shift_um, max_turn_rad=None),
        capture_um=25.0,
        symmetry=1,
        symmetry_broken_by="",
        usable_focus_um=(-5.0, 5.0),
        usable_magnification=(0.99, 1.01),
    )


def untried(chain: Sequence[str]) -> Evidence:
    """Return an empty record of trials: this plan was not benchmarked."""
    chosen = Score(
        chain=tuple(chain),
        trials=0,
        success=0,
        success_lower=0.0,
        silent=0,
        silent_upper=1.0,
        bias_um=None,
        sigma_um=None,
        worst_um=None,
        sigma_theta_rad=None,
        cost=0.0,
        reason="by hand",
    )
    return Evidence(tolerance_um=1.0, chosen=chosen, others=())


def control(**changes: float | int | str | None) -> Control:
    """Return a servo control, with changes."""
    values: dict[str, object] = {
        "method": "servo",
        "gain": 0.8,
        "gain_limit": 2.0,
        "tolerance_xy_um": 1.0,
        "tolerance_theta_rad": None,
        "max_step_um": 100.0,
        "max_cycles": 30,
        "expected_cycles": 3.5,
        "expected_s": 1.0,
        **changes,
    }
    return Control(**values)  # type: ignore[arg-type]  # names are checked above


def step(
    step_id: str,
    action: Action,
    *,
    looks: tuple[Look, ...] = (),
    moves: tuple[AxisMove, ...] = (),
    servo: Control | None = None,
) -> Step:
    """Return a step around its action."""
    return Step(
        id=step_id,
        verb=action.kind,
        key="0" * 64,
        physical=action.kind in ("grasp", "insert", "release", "move", "align"),
        irreversible=action.kind in ("insert", "release"),
        moves=moves,
        looks=looks,
        action=action,
        control=servo,
        conditions=Conditions(before=(), after=(), retreat=(), on_failure=()),
        budget=Budget(rows=(), limit_um=None, success_probability=1.0, advice=""),
    )


def stage_to(**axes: float) -> AxisMove:
    """Return a stage move."""
    return AxisMove(axes="stage", **axes)


def robot_to(**axes: float) -> AxisMove:
    """Return a robot move."""
    return AxisMove(axes="robot", **axes)


def plan_of(steps: Sequence[Step]) -> Plan:
    """Return a plan with the example's beliefs and requirements."""
    return Plan(
        format_version=FORMAT_VERSION,
        name="gear-on-shaft",
        status="feasible",
        reasons=(),
        provenance=Provenance(
            microplan="0",
            task_sha256="",
            workcell_sha256="",
            drawings_sha256={},
            seed=0,
            preset="balanced",
            max_image_error=0.002,
        ),
        requirements=Requirements(
            width_px=640,
            height_px=480,
            pitch_um=7.5,
            bits=8,
            magnification=(MAGNIFICATION, MAGNIFICATION),
            focus_um=(-10.0, 250.0),
            opening_um=(96.0, 130.0),
            travel={"stage.x_um": (-600.0, 100.0), "robot.z_um": (30.0, 400.0)},
            theta_axis_um=(0.0, 0.0),
            repeatability_um={"robot": 0.4, "stage": 1.0},
        ),
        beliefs=(
            _belief("gear", "stage", 600.0, 30.0),
            _belief("shaft_plate", "stage", 0.0, 10.0),
            _belief("tweezers", "robot", 0.0, 2.5),
        ),
        features=(
            FeaturePlace(name="gear.bore", owner="gear", x_um=0.0, y_um=0.0),
            FeaturePlace(
                name="shaft_plate.post", owner="shaft_plate", x_um=0.0, y_um=0.0
            ),
        ),
        stage_start=stage_start(),
        robot_start=robot_start(),
        opening_start_um=130.0,
        success_probability=0.9,
        success_goal=None,
        steps=tuple(steps),
        parts=_room()[0],
        fingers=_room()[1],
    )


@cache
def _room() -> tuple[tuple[Solid, ...], tuple[Fingers, ...]]:
    """Return the room that parts and fingers take up."""
    return part_solids(task()), finger_solids(task())


def _belief(name: str, carrier: str, x_um: float, sigma_um: float) -> Belief:
    """Return a belief at (x, 0)."""
    return Belief(
        name=name,
        carrier="stage" if carrier == "stage" else "robot",
        pose=Pose(x_um=x_um, y_um=0.0),
        sigma_xy_um=sigma_um,
        sigma_theta_rad=math.pi,
    )


def assembly(folder: Folder) -> Plan:
    """Return the twelve steps of the job, the look at the fingers left out."""
    alone = Seen(gear=(0, 0, 0), plate=(-600, 0, 0), opening_um=None)
    between = Seen(gear=(0, 0, 0), plate=(-600, 0, 0), opening_um=130.0)
    gripped = Seen(gear=(0, 0, 0), plate=(-600, 0, -260), opening_um=98.5)
    beside = Seen(gear=(0, 0, 0), plate=(0, -215, -260), opening_um=98.5)
    under = Seen(gear=(0, 0, 0), plate=(0, 0, -260), opening_um=98.5)
    seated = Seen(gear=(0, 0, 0), plate=(0, 0, 0), opening_um=None)
    finger = folder.look
    return plan_of(
        (
            step(
                "find_gear",
                LocateAction(target="gear", look="find_gear"),
                looks=(
                    finger(
                        "find_gear",
                        "gear",
                        alone,
                        focus_um=100.0,
                        chain=("circle_caliper", "tooth_notch"),
                    ),
                ),
            ),
            step(
                "fingers_in",
                MoveAction(),
                moves=(
                    stage_to(y_um=-180.0),
                    robot_to(x_um=0.0, y_um=0.0),
                    robot_to(z_um=30.0),
                ),
            ),
            step(
                "bring_between",
                AlignAction(
                    target="gear",
                    to="tweezers.grip",
                    look="bring_between",
                    axes="stage",
                    path=("x", "y"),
                ),
                looks=(finger("bring_between", "gear", between, focus_um=100.0),),
                servo=control(tolerance_xy_um=3.0),
            ),
            step("grasp", GraspAction(target="gear", tool="tweezers", opening_um=96.0)),
            step("lift", MoveAction(), moves=(stage_to(z_um=-260.0),)),
            step(
                "gear_in_fingers",
                LocateAction(target="gear.bore", look="gear_in_fingers"),
                looks=(
                    finger("gear_in_fingers", "gear.bore", gripped, focus_um=100.0),
                ),
            ),
            step(
                "find_shaft",
                LocateAction(target="shaft_plate.post", look="find_shaft"),
                moves=(stage_to(x_um=0.0, y_um=-215.0),),
                looks=(
                    finger(
                        "find_shaft",
                        "shaft_plate.post",
                        beside,
                        at=(0.0, -215.0),
                        focus_um=-10.0,
                        radius_um=22.0,
                    ),
                ),
            ),
            step(
                "over_shaft",
                AlignAction(
                    target="shaft_plate.post",
                    to="gear.bore",
                    look="over_shaft",
                    axes="stage",
                    path=("xy",),
                ),
                looks=(
                    finger(
                        "over_shaft",
                        "shaft_plate.post",
                        under,
                        focus_um=-10.0,
                        radius_um=22.0,
                    ),
                ),
                servo=control(tolerance_xy_um=1.0),
            ),
            step(
                "insert",
                InsertAction(
                    target="gear.bore",
                    onto="shaft_plate.post",
                    moves=(stage_to(z_um=0.0, speed_um_per_s=20.0),),
                ),
            ),
            step(
                "release",
                ReleaseAction(target="gear", tool="tweezers", opening_um=130.0),
            ),
            step(
                "retract",
                MoveAction(),
                moves=(robot_to(z_um=400.0), robot_to(y_um=3000.0)),
            ),
            step(
                "check_seated",
                VerifyAction(
                    target="gear",
                    on="shaft_plate.post",
                    look="check_gear",
                    seat_look="check_post",
                    within_um=2.9,
                    height=HeightSearch(
                        look="check_gear",
                        expected_um=100.0,
                        within_um=10.0,
                        focus_um=tuple(80.0 + 5 * i for i in range(9)),
                        ring_radius_um=25.0,
                    ),
                    empty="tweezers",
                ),
                looks=(
                    finger("check_gear", "gear", seated, focus_um=100.0),
                    finger(
                        "check_post",
                        "shaft_plate.post",
                        seated,
                        focus_um=250.0,
                        radius_um=22.0,
                    ),
                ),
            ),
        )
    )
