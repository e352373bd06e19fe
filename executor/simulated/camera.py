"""Camera of the simulated cell: images of its true world, with noise."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.devices.drivers import Counts, Frame
from microplan.executor.simulated.faults import Faults
from microplan.executor.simulated.lens import SimLens
from microplan.executor.simulated.shapes import outline_of
from microplan.executor.simulated.timeline import DeviceFaults, Timeline
from microplan.executor.simulated.truth import TrueBody, Truth
from microplan.optics.layers.shading import render_coaxial
from microplan.optics.lens.distorted_scene import lens_scene
from microplan.optics.lens.sensor import Sensor, expose
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.schemas.files.world import WorldOptics
from microplan.schemas.plan import Region
from microplan.schemas.pose import Pose

# Another defocus model than the compiler's: the cell must not share its mistakes.
BLUR_LAW = "stokseth"
SCALED = 1.1  # the magnification of a camera with the fault `scale_camera`
UNEVEN = (0.6, 0.4)  # relative change of light across the field, `uneven_light`
STALE_S = 3600.0  # how old a frame of a camera with the fault `stale_frames` is


class SimLight:
    """The light, brighter on one side."""

    def __init__(
        self, optics: WorldOptics, rng: np.random.Generator, faults: Faults
    ) -> None:
        self.model, self.serial = "simulated light", "sim-light"
        angle = rng.uniform(0, 2 * math.pi)
        self._gradient = (
            optics.light_gradient * math.cos(angle),
            optics.light_gradient * math.sin(angle),
        )
        self._level = 1.0
        self._faults = faults

    def set_level(self, level: float) -> None:
        """Set the brightness."""
        if not 0 <= level < math.inf:  # also refuses nan
            raise ValueError(f"the level is {level}, must be 0 or more")
        self._level = level

    def state(self) -> dict[str, Any]:
        """Return the level."""
        return {"level": self._level}

    def restore(self, data: Mapping[str, Any]) -> None:
        """Be where `state` says."""
        self._level = data["level"]

    def now(self) -> Illumination:
        """Return the illumination."""
        x, y = self._gradient
        if self._faults.on("uneven_light"):
            x, y = UNEVEN
        level = 0.0 if self._faults.on("light_out") else self._level
        return Illumination(gain=level, gradient_x=x, gradient_y=y)


class SimCamera:
    """The camera; `mirror` and `swap` are faults of its wiring or its mirrors."""

    def __init__(
        self,
        timeline: Timeline,
        lens: SimLens,
        light: SimLight,
        rng: np.random.Generator,
        faults: Faults,
    ) -> None:
        self.model, self.serial = "simulated camera", "sim-camera"
        self._timeline = timeline
        self._truth = timeline.truth
        self._lens = lens
        self._light = light
        self._rng = rng
        self._faults = faults
        self._trouble = DeviceFaults(faults, "camera")

    def grab(self, region: Region | None = None, *, after_s: float = 0.0) -> Frame:
        """Expose and return a frame; see `drivers.Camera`."""
        self._trouble.refuse("raises")
        self._trouble.hang("hangs")
        self._timeline.advance(max(after_s - self._truth.time_s, 0.0))
        exposed_s = self._truth.time_s
        self._timeline.advance(self._truth.world.optics.frame_time_s)
        if self._faults.on("dropped_frames"):
            raise TimeoutError("no frame within its time")
        counts = self._counts(region)
        self._timeline.changed()
        if self._faults.on("stale_frames"):
            exposed_s -= STALE_S
        if self._faults.on("short_frames"):
            counts = counts[:-1]
        return Frame(counts=counts, exposed_s=exposed_s)

    def _counts(self, region: Region | None) -> Counts:
        """Return what the sensor makes of the picture."""
        optics = self._truth.world.optics
        sensor = Sensor(
            full_well_e=optics.full_well_e,
            read_noise_e=optics.read_noise_e,
            bits=optics.bits,
        )
        window = self._window(region)
        if self._faults.on("swap_camera"):
            image = self._swapped(window)
        else:
            image = self._image(window)
        counts: Counts = expose(image, sensor, self._rng)
        return counts[:, ::-1] if self._faults.on("mirror_camera") else counts

    def _swapped(self, window: Window | None) -> FloatArray:
        """Return a picture with x and y of the world swapped.

        Pixel (row, column) shows what a square sensor of the frame's width would show
        at column (width + height) / 2 - 1 - row and row width - 1 - column.
        """
        optics = self._truth.world.optics
        wide, high = optics.width_px, optics.height_px
        at = window or Window(row=0, column=0, rows=high, columns=wide)
        square = Window(
            row=wide - at.column - at.columns,
            column=(wide + high) // 2 - at.row - at.rows,
            rows=at.columns,
            columns=at.rows,
        )
        return self._image(square, height_px=wide)[::-1, ::-1].T

    def _image(
        self, window: Window | None, *, height_px: int | None = None
    ) -> FloatArray:
        """Return what falls on the sensor, as a share of full scale."""
        microscope, focus_um = self._microscope(height_px), self._lens.focus_um
        lamp = self._truth.world.optics.lamp_share * microscope.aperture
        errors = self._lens.errors
        return render_coaxial(
            lens_scene(scene_of(self._truth), microscope, errors, focus_um),
            microscope,
            focus_um=focus_um,
            lamp_aperture=lamp or None,
            model=BLUR_LAW,
            window=window,
            light=self._light.now(),
            shift_um=self._lens.shift_um,
        )

    def _microscope(self, height_px: int | None = None) -> Microscope:
        """Return the true optical setting."""
        optics = self._truth.world.optics
        scale = SCALED if self._faults.on("scale_camera") else 1.0
        return Microscope(
            aperture=self._lens.aperture,
            wavelength_um=optics.wavelength_um,
            medium_index=optics.medium_index,
            magnification=scale * self._lens.magnification,
            pitch_um=optics.pitch_um,
            width_px=optics.width_px,
            height_px=height_px or optics.height_px,
            fill_factor=optics.fill_factor,
        )

    def _window(self, region: Region | None) -> Window | None:
        """Return the region on the sensor; a mirrored camera reads the other side."""
        if region is None:
            return None
        optics, column = self._truth.world.optics, region.column
        right, bottom = column + region.columns, region.row + region.rows
        outside = right > optics.width_px or bottom > optics.height_px
        if outside or min(region.row, column) < 0:
            raise ValueError(f"the camera has no {region}")
        if self._faults.on("mirror_camera"):
            column = optics.width_px - right
        return Window(
            row=region.row, column=column, rows=region.rows, columns=region.columns
        )


def scene_of(truth: Truth) -> Scene:
    """Return every top face where it truly is."""
    bodies = (_layers(truth, truth.bodies[name]) for name in sorted(truth.bodies))
    layers = itertools.chain(_fingers(truth), *bodies)
    return Scene(
        layers=tuple(layers),
        background=truth.world.stage_reflectance,
        background_z_um=truth.stage_z_um(),
    )


def _layers(truth: Truth, body: TrueBody) -> Iterator[Layer]:
    """Yield a body's face, the tops of its posts, and the marks on them."""
    part, top_um = body.part, truth.top_um(body)
    faces = [(part.name, body.outline, top_um, part.reflectance)]
    faces += [
        (post.name, post.outline, top_um + post.height_um, post.reflectance)
        for post in body.posts
    ]
    for name, outline, z_um, reflectance in faces:
        marks = [m for m in part.marks if m.on == name]
        shapes = [outline_of(mark.outline) for mark in marks]
        holes = tuple(ring.reversed() for shape in shapes for ring in shape.rings)
        seen = [(name, Outline(rings=outline.rings + holes), reflectance)]
        seen += [(m.name, o, m.reflectance) for m, o in zip(marks, shapes, strict=True)]
        for shown, edges, share in seen:
            yield Layer(
                name=shown,
                outline=_at(edges, truth.pose(body)),
                z_um=z_um,
                reflectance=share,
            )


def _fingers(truth: Truth) -> Iterator[Layer]:
    """Yield the tops of both fingers."""
    tool = truth.tool
    if tool is None:
        return
    grip = truth.grip_pose()
    for side, name, outline in zip(
        (-1, 1), ("left", "right"), truth.fingers, strict=True
    ):
        x_um = side * truth.opening_um / 2
        yield Layer(
            name=f"{tool.name}.{name}",
            outline=_at(outline, grip.compose(Pose(x_um=x_um, y_um=0.0))),
            z_um=truth.grip_z_um() + tool.thickness_um,
            reflectance=tool.reflectance,
        )


def _at(outline: Outline, pose: Pose) -> Outline:
    """Return an outline at a pose."""
    return place(outline, pose.x_um, pose.y_um, pose.theta_rad)
