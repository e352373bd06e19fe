"""The two-phase contract of an image routine.

`prepare` runs in the compiler and gets the renderer as an argument; `measure` runs in
both the compiler and the executor, with numpy and cv2 only. Everything here is in
pixels of the *region*, the part of the frame cut out for the look: columns go right,
rows down, pixel centres are integers. Angles are counter-clockwise as displayed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray

TargetKind = Literal["circle", "teeth", "outline", "jaws", "edge", "pair", "corner"]
# what an answer rests on: places of steps in brightness, or the brightness of an area
Principle = Literal["edges", "area"]
PoseTerm = Literal[
    "xy", "theta", "z", "zoom"
]  # what a routine gives, or needs to start


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """What is to be found, in pixels of the region.

    `parameters` hold what the kind needs, lengths in um as named:
    circle `radius_um`; teeth `count`, `outer_um`, `root_um` (radii), `phase_rad` (angle
    of a tooth's middle at theta 0) and, where something breaks the symmetry,
    `notch_rad`, `notch_radius_um` (angle and radius of its middle at theta 0),
    `notch_width_um`, and `bore_um` (radius of the round hole it is cut into);
    outline `extent_um` (radius of the circle about the reference point that holds it);
    jaws `opening_um`, `finger_width_um`, `grip_from_tip_um` (fingers extend to +y);
    edge `length_um`; pair `length_um`, `width_um` (of what lies between the two edges);
    corner `angle_rad` (inside), `reach_um` (of both legs).
    The frame of an edge or pair has its x axis across, out of the material of the first
    edge, and that of a corner along the bisector that leads out of the material.
    """

    name: str
    kind: TargetKind
    column: float  # nominal position of the reference point
    row: float
    theta_rad: float  # nominal angle
    px_per_um: float
    search_px: float  # the true place is within this of the nominal one
    theta_range_rad: float  # the true angle is within this of nominal; pi = any
    symmetry: int  # order of the rotational symmetry seen by coarse routines; 1 = none
    bright: bool  # whether the target is brighter than what surrounds it
    parameters: Mapping[str, float] = field(default_factory=dict)
    # points on the drawn edges and their normals out of the material, (x, y, nx, ny) um
    # in the target's frame at theta 0, about half a pixel apart
    contour: tuple[tuple[float, float, float, float], ...] = ()

    @property
    def size_um(self) -> float:
        """Return the larger side of the box about the contour, 0 without one."""
        points = np.array(self.contour, dtype=np.float64).reshape(-1, 4)[:, :2]
        return float(np.ptp(points, axis=0).max()) if len(points) else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Artifact:
    """What `prepare` hands to `measure`: numbers for the plan, arrays for an npz."""

    parameters: Mapping[str, float]
    arrays: Mapping[str, npt.NDArray[np.float32]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """Where to start: the nominal position, or what an earlier routine found."""

    column: float
    row: float
    theta_rad: float | None = None
    z_um: float | None = None  # of the focus from nominal
    zoom: float | None = None  # over nominal
    # `theta_rad` is not measured: the true angle is anywhere in the target's range
    theta_assumed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """Where the target is. `theta_rad` is None if the routine does not measure it."""

    column: float
    row: float
    theta_rad: float | None = None
    score: float  # 0..1, the routine's own confidence; gates compare it
    spread_px: float  # the routine's own estimate of its standard deviation per axis
    spread_theta_rad: float | None = None
    z_um: float | None = None  # of the focus from nominal
    spread_z_um: float | None = None
    z_is_signed: bool = False  # whether the sign of `z_um` is measured too
    zoom: float | None = None  # over nominal
    axis_rad: float | None = None  # the one direction in which the position is known


# Zoom errors stay below 2 %; what is farther off is another thing. Edges out of focus
# are found beside their places, by a larger share of the size of a small target.
_SCALE_OFF, _MOST_SCALE_OFF = 0.03, 0.05
_EDGE_PX = 1.5
_ZOOM_SIGMAS = 3.0  # unless zoom errors that were stated are larger


def scale_limit(target: Target, zoom_sigma: float) -> float:
    """Return how far off 1 a target's size may be, by the zoom's relative sigma."""
    radius_px = target.size_um / 2 * target.px_per_um
    by_edges = min(_EDGE_PX / max(radius_px, 1.0), _MOST_SCALE_OFF)
    return max(_SCALE_OFF, by_edges, _ZOOM_SIGMAS * zoom_sigma)


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a routine gives no answer: a stable code and a sentence with the numbers."""

    code: str  # e.g. "no_edge", "low_score", "outside", "ambiguous"
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraNoise:
    """The noise of the camera; full scale is full well.

    A `table` is all of it, whatever the electrons: (2, K) shares of full scale, rising,
    and the variance of a pixel there, full scale squared.
    """

    full_well_e: float
    read_noise_e: float  # one standard deviation
    bits: int
    fill_factor: float  # light-sensitive share of a pixel's area
    table: FloatArray | None = field(default=None, compare=False)
    floor: float = 0.0  # light below which the least count comes, of full scale
    ceiling: float = 1.0  # light above which the greatest comes
    # standard deviation of pixels from any model, which no frame averages, full scale
    misfit: float = 0.0

    def variance(self, image: FloatArray) -> FloatArray:
        """Return the variance of pixels, (...), by their mean, full scale squared.

        Noise, and what pixels differ by from any model.
        """
        found: FloatArray = self.noise_variance(image) + self.misfit**2
        return found

    def noise_variance(self, image: FloatArray) -> FloatArray:
        """Return the variance of noise alone, as `variance`.

        Shot noise, read noise and rounding to counts; or as the `table` says.
        """
        if self.table is not None:
            stated: FloatArray = np.interp(image, *self.table)
            return stated
        read, levels = self.read_noise_e / self.full_well_e, 2**self.bits - 1
        shot = np.maximum(image, 0.0) / self.full_well_e
        noise: FloatArray = shot + read**2 + 1 / (12 * levels**2)
        return noise


@dataclass(frozen=True, slots=True, kw_only=True)
class Blur:
    """What the optics can show."""

    cutoff_per_um: float  # finest detail with any contrast, cycles/um
    depth_um: float  # wave depth of field
    cone: float  # radius of the blur over the defocus


@dataclass(frozen=True, slots=True, kw_only=True)
class Nuisances:
    """What an image may differ in from the nominal one besides the target's pose."""

    focus_sigma_um: float
    zoom_sigma: float  # of the ratio to nominal
    gradient: float  # the largest relative change of the light across the field
    axis_px: tuple[float, float]  # column and row of the region that zoom leaves alone
    has_lines: bool = False  # edges may be bright lines, and walls throw shadows


@dataclass(frozen=True, slots=True, kw_only=True)
class Occluders:
    """Occluders of the target: image = light + through x target alone."""

    light: FloatArray  # (rows, columns) sent back by the occluders
    through: FloatArray  # (rows, columns) share of the target's light let through


@dataclass(frozen=True, slots=True, kw_only=True)
class OccluderMode:
    """What one likely error in the position or angle of the static scene changes.

    Such errors are independent and have mean 0: the sum of the products of their
    changes is the covariance of the image.
    """

    shown: FloatArray  # (rows, columns) change of the image, the target as planned
    through: FloatArray  # (rows, columns) change of the share let through


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceChange:
    """What walls or faces of bodies may change of the image, target displaced.

    Its amount is between none and all of it.
    """

    places_um: tuple[tuple[float, float], ...]  # displacements of the target, N
    shown: FloatArray  # (N, rows, columns) change of the image
    is_still: bool = False  # it stays with the bodies beside the target
    body_sigma_um: float = 0.0  # standard deviation of their position


class LookModel(Protocol):
    """All that a routine may ask of the look it is prepared for."""

    @property
    def camera(self) -> CameraNoise:
        """Return the camera's noise."""
        ...

    @property
    def blur(self) -> Blur:
        """Return what the optics can show."""
        ...

    @property
    def nuisances(self) -> Nuisances:
        """Return what else the trials of this look vary."""
        ...

    def __call__(
        self,
        *,
        dx_um: float = 0.0,
        dy_um: float = 0.0,
        theta_rad: float = 0.0,
        dz_um: float = 0.0,
        zoom: float = 1.0,
    ) -> FloatArray:
        """Return the (rows, columns) noise-free image, 0..1 of full scale."""
        ...

    def template(
        self, dz_um: Sequence[float], *, over: int, half_px: tuple[int, int]
    ) -> FloatArray:
        """Return the target alone at its nominal pose, without pixels' area.

        Parameters
        ----------
        dz_um : (K,) sequence of float
            Of the focus from nominal.
        over : int
            Samples per pixel, odd.
        half_px : (columns, rows)
            Half the template's sides, px.

        Returns
        -------
        (K, 2 R over + 1, 2 C over + 1) float64 array
            Light at points, 0..1 of full scale; the middle sample is at the centre of
            the pixel nearest the target's reference point.
        """
        ...

    def alone(
        self, *, dx_um: float = 0.0, dy_um: float = 0.0, dz_um: float = 0.0
    ) -> FloatArray:
        """Return the image without the static scene, (rows, columns), not clipped."""
        ...

    def occluders(self, dz_um: float = 0.0) -> Occluders:
        """Return the target's occluders, `dz_um` off nominal focus."""
        ...

    def occluder_modes(self) -> Sequence[OccluderMode]:
        """Return the image changes by likely displacements of the static scene."""
        ...

    def surface_changes(self) -> Sequence[SurfaceChange]:
        """Return the image changes by walls and faces that are not known."""
        ...

    def line_images(self) -> Sequence[FloatArray]:
        """Return the images that lines of rounded edges may make it, 0..1."""
        ...


Prepare = Callable[[LookModel, Target], Artifact | Failure]
Measure = Callable[[FloatArray, Artifact, Guess], Measurement | Failure]
Cost = Callable[[Artifact, int], float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Routine:
    """Declaration of one image routine: what it looks for, and its three functions.

    `prepare(model, target)` returns what `measure` needs, computed from the nominal
    image. `measure(image, artifact, guess)` returns where the target is in an image,
    (rows, columns) 0..1 of full scale, which it does not change, or why not.
    `cost(artifact, pixels)` returns the predicted work of one `measure` on a region of
    so many pixels, in 640 x 480 box filters of 64-bit pixels; it depends on nothing
    measured.
    """

    name: str  # its key in the registry
    version: str
    kinds: tuple[TargetKind, ...]  # target kinds it can look for
    principle: Principle  # two of different ones seldom fail on the same image
    provides: tuple[PoseTerm, ...]
    requires: tuple[PoseTerm, ...] = ()  # of the guess, better than nominal
    capture_px: float = math.inf  # how far off the guess may be; inf: `search_px`
    baseline: bool = False  # known to be bad: tried where asked for only
    expensive: bool = False  # dozens of images to prepare: tried where others fail
    prepare: Prepare
    measure: Measure
    cost: Cost


FRAME_PX = 640 * 480  # what a unit of cost filters
