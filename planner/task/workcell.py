"""The workcell: optics, camera, light, axes, tools, as the file describes them.

Angles are radians and uncertainties one standard deviation; the reader converts
degrees, arc seconds and the stated coverage once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from microplan.optics.coherence.degree import Coherence
from microplan.optics.lens.lens import LensErrors
from microplan.optics.lens.response import Response
from microplan.optics.lens.sensor import Sensor
from microplan.optics.outline.outline import Outline
from microplan.planner.source.diagnostics import Span
from microplan.planner.task.drawings import DrawingSheet
from microplan.planner.task.finishes import SurfaceFinish

Interval = tuple[float, float]

RINGS = ("ring", "dark_field")  # kinds of light from around the objective


@dataclass(frozen=True, slots=True, kw_only=True)
class Zoom:
    """The zoom drive: how long a change takes and what it costs in accuracy."""

    time_s: float
    parcentric_sigma_um: float  # lateral jump of the image per zoom change
    scale_sigma: float  # relative error of the magnification


@dataclass(frozen=True, slots=True, kw_only=True)
class Focus:
    """The focus drive; heights are world heights of the plane in focus."""

    min_um: float
    max_um: float
    time_s: float
    repeatability_um: float
    lateral_sigma_um_per_um: float  # sideways shift per um of focus travel, per axis


@dataclass(frozen=True, slots=True, kw_only=True)
class ZernikeTerm:
    """One aberration of the objective, Noll's index and normalisation."""

    noll: int
    waves: float  # rms over the pupil, with its sign
    sigma_waves: float = 0.0  # what is not known of it, one standard deviation


@dataclass(frozen=True, slots=True, kw_only=True)
class WavefrontSpec:
    """The objective's wavefront error: its terms, or all that is known of their sum."""

    terms: tuple[ZernikeTerm, ...] | None = None  # None: not stated
    rms_waves: float | None = None  # most of all terms together; None: not stated

    @property
    def known(self) -> tuple[tuple[int, float], ...]:
        """Return what is stated: Noll's index and waves rms of each term, not 0."""
        return tuple((term.noll, term.waves) for term in self.terms or () if term.waves)


@dataclass(frozen=True, slots=True, kw_only=True)
class HaloSpec:
    """The share of all light that an objective scatters around each point."""

    radius_um: float  # standard deviation of a Gaussian
    share: float

    @property
    def known(self) -> tuple[float, float] | None:
        """Return radius and share, None where there is none."""
        return (self.radius_um, self.share) if self.share > 0 else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Optics:
    """The microscope: zoom range, aperture by zoom, light and drives."""

    magnification: Interval
    apertures: tuple[tuple[float, float], ...]  # (magnification, aperture), ascending
    wavelength_um: float
    medium_index: float
    coherence: Coherence | None  # None: incoherent
    zoom: Zoom
    focus: Focus
    lens: LensErrors  # without the light's gradient and edge offsets
    wavefront: WavefrontSpec = WavefrontSpec()
    halo: HaloSpec | None = None  # None: not stated

    def aperture(self, magnification: float) -> float:
        """Return the aperture at `magnification`, that of the nearest row beyond all.

        Between rows as in `microplan.optics.lens.lens.LensErrors.aperture_at`.
        """
        if not self.lens.apertures:
            return self.apertures[0][1]
        first, last = self.apertures[0][0], self.apertures[-1][0]
        return self.lens.aperture_at(min(max(magnification, first), last))


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSpec:
    """The sensor and its timing."""

    pitch_um: float
    width_px: int
    height_px: int
    fill_factor: float
    rate_hz: float
    latency_frames: int
    bits: int
    full_well_e: float
    read_noise_e: float
    exposure_ms: Interval
    response: Response | None = None  # None: counts in proportion to light
    is_response_stated: bool = False
    noise: tuple[tuple[float, float], ...] = ()  # counts, variance in counts squared
    pattern_gain: float = 0.0  # one standard deviation of pixels' gain
    pattern_counts: float = 0.0  # one standard deviation of pixels' offset

    @property
    def sensor(self) -> Sensor:
        """Return the sensor as images are exposed with it."""
        return Sensor(
            full_well_e=self.full_well_e,
            read_noise_e=self.read_noise_e,
            bits=self.bits,
            response=self.response,
            noise=self.noise,
            pattern_gain=self.pattern_gain,
            pattern_counts=self.pattern_counts,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LightSpec:
    """The illumination."""

    kind: str
    level: Interval
    gradient: float  # relative change across the field, any direction
    aperture: float | None = None  # of a lamp below
    elevation_rad: Interval | None = None  # of a ring

    @property
    def is_transmitted(self) -> bool:
        """Return whether it comes from below."""
        return self.kind == "transmitted"

    @property
    def is_ring(self) -> bool:
        """Return whether it comes from around the objective."""
        return self.kind in RINGS


@dataclass(frozen=True, slots=True, kw_only=True)
class AxesSpec:
    """A stage or robot: x, y, z and theta with their repeatability, one sigma."""

    repeatability_xy_um: float
    repeatability_z_um: float
    repeatability_theta_rad: float
    limits: Mapping[str, Interval]  # x_um, y_um, z_um, theta_rad
    speed_xy_um_per_s: float
    speed_z_um_per_s: float
    speed_theta_rad_per_s: float
    settle_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """The stage: its axes, and the world it carries."""

    axes: AxesSpec
    datum_z_um: float
    reflectance: float
    theta_axis_um: tuple[float, float]
    drift_um_per_min: float
    axis_tilt_sigma_rad: float
    finish: Interval | None = None  # of its surface; None: not stated
    transmittance: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """The robot that carries the tool."""

    axes: AxesSpec
    theta_axis_to_tip_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Tool:
    """Tweezers: two fingers drawn at opening 0, extending to +y, the grip at (0, 0).

    `left` and `right` are the fingers in the grip's frame with the jaws closed; at
    opening w they move apart by w / 2 each along -x and +x.
    """

    name: str
    left: Outline
    right: Outline
    thickness_um: float
    finger_width_um: float
    length_um: float
    opening_um: Interval
    grip_from_tip_um: float
    reflectance: float
    surface: SurfaceFinish
    stick_probability: float  # that a released part follows a finger
    free_length_um: float | None  # of a finger, from where it bends; None: not stated
    youngs_modulus_gpa: float | None
    sheet: DrawingSheet
    where: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Servo:
    """How visual servoing runs."""

    rate_hz: float
    gain: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscrepancyShares:
    """How far real pictures lie from modelled ones, one standard deviation each."""

    edge: float  # of the step between an edge's two faces
    flat: float  # of the local light
    pixel: float  # of the step at the target's edges
    is_stated: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Workcell:
    """Everything a workcell file says."""

    name: str
    optics: Optics
    camera: CameraSpec
    light: LightSpec
    stage: Stage
    robot: Robot
    tools: Mapping[str, Tool]
    servo: Servo
    discrepancy: DiscrepancyShares
    normalised: Mapping[str, object]  # plain data, defaults filled in, for hashing
