"""Assembly of a simulated cell from world.json: its truth, its devices."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from microplan.executor.devices.safety import Rules, Safety, Settle, Speeds
from microplan.executor.devices.station import Offer, Station
from microplan.executor.simulated.axes import DriveError, SimAxes
from microplan.executor.simulated.camera import (
    Pictures,
    SimCamera,
    SimLight,
    drawn_pattern,
    drawn_picture_errors,
)
from microplan.executor.simulated.cameras.kinds import CameraKind
from microplan.executor.simulated.cameras.solid_pictures import SolidPictures
from microplan.executor.simulated.faults import Faults
from microplan.executor.simulated.gripper import SimGripper
from microplan.executor.simulated.judging import Verdict, judge
from microplan.executor.simulated.lens import SimLens, drawn_errors
from microplan.executor.simulated.timeline import (
    RENDER_S,
    DeviceFaults,
    SimClock,
    Timeline,
)
from microplan.executor.simulated.truth import Truth, made_truth
from microplan.schemas.files.world import World, WorldAxes

# Each purpose has its own stream, so that one more draw here moves nothing there.
PURPOSES = (
    "start", "profile", "tilt", "lateral", "drift",
    "zoom", "focus", "stage", "robot", "light", "noise", "stick", "lens", "surface",
    "pattern", "discrepancy",
)  # fmt: skip

SHOWN_LIGHT = "coaxial"  # kind of light that both cameras show


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
    draws: Mapping[str, np.random.Generator]  # by purpose

    def judge(
        self,
        target: str,
        on: str,
        within_um: float = 0.0,
        within_rad: float | None = None,
    ) -> Verdict:
        """Return whether the part of `target` truly sits on `on`.

        By true pose and height: the underside on the face of the seat's part, the tool
        has let go, and the hole is around the post; where the seat is a round hole, the
        target's own position is within `within_um` of its middle. Where `within_rad` is
        stated, the part is rotated no farther against the seat's part.

        Raises
        ------
        ValueError
            If there is no such part, post or hole.
        """
        return judge(self.truth, target, on, within_um, within_rad)

    def shown_um(self, owner: str, x_um: float, y_um: float) -> tuple[float, float]:
        """Return the true shown position, um, of a point of a part or of the grip.

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
    drives: Mapping[str, DriveError] | None = None,
    camera: CameraKind = "quick",
) -> Cell:
    """Return a cell whose errors are drawn from `seed`.

    Parameters
    ----------
    world : World
        What `world.json` describes.
    seed : int
        Root of all the cell's random numbers.
    faults : iterable of str
        Names of `microplan.executor.simulated.faults.FAULTS`, or NAME@STEP.
    drives : mapping of str to DriveError
        By "stage" and "robot"; a drive that is left out is where it reads.
    camera : "solid" or "quick"
        Solid bodies seen by the cell's own rays and waves, or the compiler's renderer:
        quick, and no judge of an image.

    Raises
    ------
    ValueError
        If the camera is none, or the world's light is not of kind `SHOWN_LIGHT`.
    """
    if (kind := world.optics.light_kind) != SHOWN_LIGHT:
        raise ValueError(f"the cell shows {SHOWN_LIGHT} light alone, not {kind}")
    rng, made = _generators(seed), drives or {}
    wrong = Faults(faults)
    truth = made_truth(world, rng, missing=wrong.on("no_part"))
    timeline = Timeline(truth)
    stage, robot = (
        SimAxes(
            timeline, name, state, rng[name], DeviceFaults(wrong, "axis"),
            drive=made.get(name),
        )
        for name, state in (("stage", truth.stage), ("robot", truth.robot))
    )  # fmt: skip
    lens = _lens(timeline, rng, wrong)
    light = SimLight(world.optics, rng["light"], wrong)
    clock = SimClock(timeline)
    pictures = _pictures(camera, truth, lens)
    pattern = drawn_pattern(world.optics, rng["pattern"])
    errors = drawn_picture_errors(lens, world.optics, rng["discrepancy"])
    eye = SimCamera(timeline, pictures, light, rng["noise"], wrong, pattern, errors)
    stick = 0.0 if truth.tool is None else truth.tool.stick_probability
    jaws = SimGripper(timeline, rng["stick"], DeviceFaults(wrong, "jaws"), stick=stick)
    station = Station(
        stage=stage,
        robot=robot,
        gripper=None if truth.tool is None else jaws,
        lens=lens,
        light=light,
        camera=eye,
        clock=clock,
        offer=offer_of(world),
        rules=rules_of(world, hangs=wrong.is_asked("camera_hangs")),
    )
    return Cell(
        truth=truth, station=station, stage=stage, robot=robot, jaws=jaws, lens=lens,
        light=light, camera=eye, clock=clock, faults=wrong, timeline=timeline,
        draws=rng,
    )  # fmt: skip


def _pictures(kind: CameraKind, truth: Truth, lens: SimLens) -> Pictures:
    """Return what the camera shows the world by."""
    if kind == "quick":
        # optics only for who asks for it
        from microplan.executor.simulated.cameras.quick_pictures import QuickPictures

        return QuickPictures(truth, lens)
    if kind != "solid":
        raise ValueError(f"the camera is solid or quick, not {kind!r}")
    return SolidPictures(truth, lens)


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
        DeviceFaults(faults, "lens"),
    )


def offer_of(world: World) -> Offer:
    """Return the capabilities of the simulated devices."""
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


def rules_of(world: World, *, hangs: bool = False) -> Rules:
    """Return the rules of the simulated axes, and of a camera that renders.

    One that `hangs` is given up as soon as any other.
    """
    usual = Safety()
    return Rules(
        safety=usual if hangs else replace(usual, grab_s=RENDER_S),
        # the workcell's dwell; the readings are the commands
        stage=Settle(dwell_s=world.stage.settle_s),
        robot=Settle(dwell_s=world.robot.settle_s),
        stage_datum_z_um=world.stage_datum_z_um,
        stage_speeds=_speeds(world.stage),
        robot_speeds=_speeds(world.robot),
    )


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
