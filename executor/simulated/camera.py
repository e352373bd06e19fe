"""Camera of the simulated cell: images of its true world, with noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.devices.drivers import Counts, Frame
from microplan.executor.simulated.faults import Faults
from microplan.executor.simulated.imaging.electrons import (
    Chip,
    PixelPattern,
    counted,
)
from microplan.executor.simulated.imaging.imaging_view import LampLevel, PixelWindow
from microplan.executor.simulated.imaging.picture_errors import PictureErrors
from microplan.executor.simulated.lens import SimLens
from microplan.executor.simulated.timeline import DeviceFaults, Timeline
from microplan.schemas.files.world import WorldOptics
from microplan.schemas.plan import Region

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

    def now(self) -> LampLevel:
        """Return the light as it is now."""
        x, y = self._gradient
        if self._faults.on("uneven_light"):
            x, y = UNEVEN
        level = 0.0 if self._faults.on("light_out") else self._level
        return LampLevel(level=level, gradient_x=x, gradient_y=y)


class Pictures(Protocol):
    """What draws the true world: rays and waves, or the compiler's own renderer."""

    def image(
        self,
        window: PixelWindow,
        lamp: LampLevel,
        *,
        height_px: int,
        scale: float,
    ) -> FloatArray:
        """Return a part of a frame so high, (rows, columns) shares of full scale.

        Windows are in px; `scale` times the true magnification is what the lens shows.
        """
        ...


class SimCamera:
    """The camera; `mirror` and `swap` are faults of its wiring or its mirrors."""

    def __init__(
        self,
        timeline: Timeline,
        pictures: Pictures,
        light: SimLight,
        rng: np.random.Generator,
        faults: Faults,
        pattern: PixelPattern | None = None,
        errors: LensPictureErrors | None = None,
    ) -> None:
        self.model, self.serial = "simulated camera", "sim-camera"
        self._timeline = timeline
        self._truth = timeline.truth
        self.pictures = pictures
        self._light = light
        self._rng = rng
        self._chip, self._pattern = _chip(timeline.truth.world.optics), pattern
        self._errors = errors
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
        window = self._window(region)
        if self._faults.on("swap_camera"):
            image = self._swapped(window)
        else:
            image = self._image(window, self._truth.world.optics.height_px)
        if self._errors is not None:
            image = image + self._errors.of(image)
        here = None
        if self._pattern is not None:
            here = self._pattern.part(window.row, window.column, image.shape)
        counts = counted(image, self._chip, self._rng, here)
        return counts[:, ::-1] if self._faults.on("mirror_camera") else counts

    def _swapped(self, at: PixelWindow) -> FloatArray:
        """Return a picture with x and y of the world swapped.

        Pixel (row, column) shows what a square sensor of the frame's width would show
        at column (width + height) / 2 - 1 - row and row width - 1 - column.
        """
        optics = self._truth.world.optics
        wide, high = optics.width_px, optics.height_px
        square = PixelWindow(
            row=wide - at.column - at.columns,
            column=(wide + high) // 2 - at.row - at.rows,
            rows=at.columns,
            columns=at.rows,
        )
        return self._image(square, wide)[::-1, ::-1].T

    def _image(self, window: PixelWindow, height_px: int) -> FloatArray:
        """Return what falls on the sensor, as a share of full scale."""
        scale = SCALED if self._faults.on("scale_camera") else 1.0
        return self.pictures.image(
            window, self._light.now(), height_px=height_px, scale=scale
        )

    def _window(self, region: Region | None) -> PixelWindow:
        """Return the region on the sensor; a mirrored camera reads the other side."""
        optics = self._truth.world.optics
        if region is None:
            region = Region(
                row=0, column=0, rows=optics.height_px, columns=optics.width_px
            )
        column = region.column
        right, bottom = column + region.columns, region.row + region.rows
        outside = right > optics.width_px or bottom > optics.height_px
        if outside or min(region.row, column) < 0:
            raise ValueError(f"the camera has no {region}")
        if self._faults.on("mirror_camera"):
            column = optics.width_px - right
        return PixelWindow(
            row=region.row, column=column, rows=region.rows, columns=region.columns
        )


def _chip(optics: WorldOptics) -> Chip:
    """Return the world's sensor."""
    return Chip(
        full_well_e=optics.full_well_e,
        read_noise_e=optics.read_noise_e,
        bits=optics.bits,
        response=optics.response,
        noise=optics.noise,
    )


@dataclass(frozen=True, slots=True)
class LensPictureErrors:
    """How pictures differ from images, at the setting that a lens has."""

    errors: PictureErrors
    lens: SimLens

    def of(self, image: FloatArray) -> FloatArray:
        """Return what a picture shows besides its image, both (rows, columns)."""
        optics, setting = self.lens.optics, self.lens.commanded
        wave_um = optics.wavelength_um / self.lens.aperture
        blur_px = wave_um * setting[0] / optics.pitch_um
        return self.errors.of(image, blur_px, setting)


def drawn_picture_errors(
    lens: SimLens, optics: WorldOptics, rng: np.random.Generator
) -> LensPictureErrors | None:
    """Return how pictures differ from images, None where they do not."""
    errors = PictureErrors(
        edge=optics.discrepancy_edge,
        flat=optics.discrepancy_flat,
        pixel=optics.discrepancy_pixel,
        seed=int(rng.integers(2**62)),
    )
    if errors.edge == errors.flat == errors.pixel == 0:
        return None
    return LensPictureErrors(errors, lens)


def drawn_pattern(optics: WorldOptics, rng: np.random.Generator) -> PixelPattern | None:
    """Return the fixed pattern of a camera's pixels, None where there is none."""
    if not (optics.pattern_gain or optics.pattern_counts):
        return None
    shape = (optics.height_px, optics.width_px)
    return PixelPattern.drawn(shape, optics.pattern_gain, optics.pattern_counts, rng)
