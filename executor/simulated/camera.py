"""The simulated microscope: what the true world looks like, with noise."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from executor.drivers import Counts
from executor.errors import ExecutorError
from executor.simulated.truth import Body, Truth
from optics.lens import MAX_DISTORTION, LensErrors
from optics.lensing import lens_scene
from optics.microscope import Microscope
from optics.outline import Outline, place
from optics.scene import Illumination, Layer, Scene, Window
from optics.sensor import Sensor, expose
from optics.shading import shaded
from schemas.plan import Region
from schemas.pose import Pose
from schemas.world import WorldLens, WorldOptics

FloatArray = npt.NDArray[np.float64]

# The cell is not the compiler's judge if both share one model: another blur law, and
# an aperture that is not the one in the data sheet.
BLUR_LAW = "stokseth"
APERTURE_RATIO = 1.02
_MOST_SINE = 0.999  # of the marginal ray


class SimLens:
    """Zoom and focus: every move lands a little elsewhere."""

    def __init__(
        self,
        truth: Truth,
        zoom_rng: np.random.Generator,
        focus_rng: np.random.Generator,
        lateral: tuple[float, float],
        errors: LensErrors,
    ) -> None:
        self._truth = truth
        self._optics = truth.world.optics
        self._zoom_rng = zoom_rng
        self._focus_rng = focus_rng
        self._lateral = lateral  # um sideways per um of focus
        self.errors = errors
        self.magnification = self._optics.magnification[0]
        self.focus_um = 0.0
        self._jump = (0.0, 0.0)
        self._nominal = self.magnification

    def set_magnification(self, magnification: float) -> None:
        """Zoom: the image jumps and the scale is off by a new amount."""
        scale, x, y = self._zoom_rng.standard_normal(3)
        self._nominal = magnification
        self.magnification = magnification * (1 + self._optics.scale_sigma * scale)
        sigma_um = self._optics.parcentric_sigma_um
        self._jump = (sigma_um * x, sigma_um * y)
        self._truth.time_s += self._optics.zoom_time_s

    def set_focus_um(self, focus_um: float) -> None:
        """Focus, with its repeatability."""
        error_um = (
            self._optics.focus_repeatability_um * self._focus_rng.standard_normal()
        )
        self.focus_um = focus_um + error_um
        self._truth.time_s += self._optics.focus_time_s

    @property
    def shift_um(self) -> tuple[float, float]:
        """Return how far the whole image is off."""
        x, y = self._lateral
        return (self._jump[0] + x * self.focus_um, self._jump[1] + y * self.focus_um)

    @property
    def aperture(self) -> float:
        """Return the true aperture at the zoom that was set."""
        zoom, aperture = np.log(np.array(self._optics.apertures)).T
        stated = math.exp(np.interp(math.log(self._nominal), zoom, aperture))
        return min(stated * APERTURE_RATIO, _MOST_SINE * self._optics.medium_index)


def drawn_errors(lens: WorldLens, rng: np.random.Generator) -> LensErrors:
    """Return what the lens truly does: the known part and a draw of the unknown."""
    distortion, scale, curvature = rng.standard_normal(3)
    true = lens.distortion + lens.distortion_sigma * distortion
    return LensErrors(
        distortion=max(min(true, MAX_DISTORTION), -MAX_DISTORTION),
        lateral_x=lens.lateral_um_per_um[0],
        lateral_y=lens.lateral_um_per_um[1],
        scale_per_um=lens.scale_per_um + lens.scale_sigma_per_um * scale,
        field_curvature_per_um=lens.field_curvature_per_um
        + lens.field_curvature_sigma_per_um * curvature,
    )


class SimLight:
    """The light, brighter on one side."""

    def __init__(self, optics: WorldOptics, rng: np.random.Generator) -> None:
        angle = rng.uniform(0, 2 * math.pi)
        self._gradient = (
            optics.light_gradient * math.cos(angle),
            optics.light_gradient * math.sin(angle),
        )
        self._level = 1.0

    def set_level(self, level: float) -> None:
        """Set the brightness."""
        self._level = level

    def now(self) -> Illumination:
        """Return the illumination."""
        x, y = self._gradient
        return Illumination(gain=self._level, gradient_x=x, gradient_y=y)


class SimCamera:
    """The camera; `mirror` swaps left and right, a wiring fault."""

    def __init__(
        self,
        truth: Truth,
        lens: SimLens,
        light: SimLight,
        rng: np.random.Generator,
        *,
        mirror: bool = False,
    ) -> None:
        self._truth = truth
        self._lens = lens
        self._light = light
        self._rng = rng
        self._mirror = mirror

    def grab(self, region: Region | None = None) -> Counts:
        """Expose and return a frame; see `executor.drivers.Camera`."""
        optics = self._truth.world.optics
        self._truth.time_s += optics.frame_time_s
        image = self._image(self._window(region))
        sensor = Sensor(
            full_well_e=optics.full_well_e,
            read_noise_e=optics.read_noise_e,
            bits=optics.bits,
        )
        counts: Counts = expose(image, sensor, self._rng)
        return counts[:, ::-1] if self._mirror else counts

    def _image(self, window: Window | None) -> FloatArray:
        """Return what falls on the sensor, as a share of full scale."""
        microscope, focus_um = self._microscope(), self._lens.focus_um
        lamp = self._truth.world.optics.lamp_share * microscope.aperture
        errors = self._lens.errors
        return shaded(
            lens_scene(scene_of(self._truth), microscope, errors, focus_um),
            microscope,
            focus_um=focus_um,
            lamp_aperture=lamp or None,
            model=BLUR_LAW,
            window=window,
            light=self._light.now(),
            shift_um=self._lens.shift_um,
        )

    def _microscope(self) -> Microscope:
        """Return the true optical setting."""
        optics = self._truth.world.optics
        return Microscope(
            aperture=self._lens.aperture,
            wavelength_um=optics.wavelength_um,
            medium_index=optics.medium_index,
            magnification=self._lens.magnification,
            pitch_um=optics.pitch_um,
            width_px=optics.width_px,
            height_px=optics.height_px,
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
            raise ExecutorError("MP841", f"the camera has no {region}")
        if self._mirror:
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


def _layers(truth: Truth, body: Body) -> Iterator[Layer]:
    """Yield a body's face and the tops of its posts."""
    pose, top_um = truth.pose(body), truth.top_um(body)
    yield Layer(
        name=body.part.name,
        outline=_at(body.outline, pose),
        z_um=top_um,
        reflectance=body.part.reflectance,
    )
    for post in body.posts:
        yield Layer(
            name=post.name,
            outline=_at(post.outline, pose),
            z_um=top_um + post.height_um,
            reflectance=post.reflectance,
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
