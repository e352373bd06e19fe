"""The world of a simulated cell: what a real cell would simply contain.

Only the simulated cell and reports read it; a live run works with it deleted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from schemas.plan import AxisMove
from schemas.pose import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldRing:
    """A closed ring; an edge of 4 numbers is a segment x0 y0 x1 y1, one of 5 an arc.

    An arc is center x, y, radius, start angle, signed sweep; um and rad.
    """

    layer: str
    edges: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldOutline:
    """Rings: outer ones counter-clockwise, holes clockwise."""

    rings: tuple[WorldRing, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldPost:
    """A prism standing on a part's top face, in the part's frame."""

    name: str  # "shaft_plate.post"
    outline: WorldOutline
    height_um: float
    reflectance: float
    center_um: tuple[float, float]
    radius_um: float
    profile_tolerance_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldHole:
    """A round hole of a part that can receive a post, in the part's frame."""

    name: str  # "gear.bore"
    center_um: tuple[float, float]
    radius_um: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldPart:
    """A body: its prism, posts, holes and where it starts on the stage."""

    name: str
    outline: WorldOutline
    thickness_um: float
    reflectance: float
    profile_tolerance_um: float  # hard limit of the edge offset, per side
    posts: tuple[WorldPost, ...]
    holes: tuple[WorldHole, ...]
    hull_minima_rad: tuple[float, ...]  # angles at which the hull is narrowest along x
    start: Pose  # on the stage at reading 0
    theta_any: bool
    sigma_xy_um: float
    sigma_theta_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldTool:
    """Tweezers: fingers in the grip's frame with the jaws closed."""

    name: str
    left: WorldOutline
    right: WorldOutline
    thickness_um: float
    reflectance: float
    opening_um: tuple[float, float]
    start_opening_um: float
    stick_probability: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldAxes:
    """One axis group: spreads are one sigma."""

    start: AxisMove
    repeatability_xy_um: float
    repeatability_z_um: float
    repeatability_theta_rad: float
    limits: Mapping[str, tuple[float, float]]
    speed_xy_um_per_s: float
    speed_z_um_per_s: float
    speed_theta_rad_per_s: float
    settle_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldLens:
    """Systematic errors of the lens as stated, and one sigma of what is not known.

    As in `optics.lens.LensErrors`: by the defocus of a point, not by the focus travel.
    """

    distortion: float = 0.0
    distortion_sigma: float = 0.0
    lateral_um_per_um: tuple[float, float] = (0.0, 0.0)
    scale_per_um: float = 0.0
    scale_sigma_per_um: float = 0.0
    field_curvature_per_um: float = 0.0
    field_curvature_sigma_per_um: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldOptics:
    """Microscope and camera."""

    magnification: tuple[float, float]
    apertures: tuple[tuple[float, float], ...]
    wavelength_um: float
    medium_index: float
    pitch_um: float
    width_px: int
    height_px: int
    fill_factor: float
    bits: int
    full_well_e: float
    read_noise_e: float
    zoom_time_s: float
    parcentric_sigma_um: float
    scale_sigma: float
    focus_um: tuple[float, float]
    focus_time_s: float
    focus_repeatability_um: float
    lateral_sigma_um_per_um: float
    frame_time_s: float
    light: tuple[float, float]
    light_gradient: float
    lens: WorldLens = WorldLens()
    lamp_share: float = 0.0  # of coaxial light's aperture in the lens'; 0: other light


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """Everything the simulated cell contains."""

    name: str
    optics: WorldOptics
    stage: WorldAxes
    stage_datum_z_um: float
    stage_reflectance: float
    stage_theta_axis_um: tuple[float, float]
    stage_tilt_sigma_rad: float
    stage_drift_um_per_min: float
    robot: WorldAxes
    robot_theta_axis_to_tip_um: float
    parts: tuple[WorldPart, ...]
    tools: tuple[WorldTool, ...]
