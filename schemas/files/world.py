"""The world of a simulated cell: bodies, optics, axes, tools.

Only the simulated cell and reports read it; a live run works with it deleted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from microplan.schemas.plan import AxisMove
from microplan.schemas.pose import Pose

LightKind = Literal["coaxial", "ring", "dark_field", "transmitted"]


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldRing:
    """A closed ring; an edge of 4 numbers is a segment x0 y0 x1 y1, one of 5 an arc.

    An arc is center x, y, radius, start angle, signed sweep; um and rad.
    """

    layer: str  # of the drawing
    edges: tuple[tuple[float, ...], ...]  # in order, closed


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldOutline:
    """Rings: outer ones counter-clockwise, holes clockwise."""

    rings: tuple[WorldRing, ...]  # with their holes


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldPost:
    """A prism standing on a part's top face, in the part's frame."""

    name: str  # "shaft_plate.post"
    outline: WorldOutline  # in the part's frame
    height_um: float  # above the part's top face
    reflectance: float  # of its top face
    center_um: tuple[float, float]  # of its circle
    radius_um: float  # of its circle
    profile_tolerance_um: float  # hard limit of the edge offset
    # of the walls, least and most; 0: black
    wall_reflectance: tuple[float, float] = (0.0, 0.0)
    # share of the top face's light that a mirror gives back, least and most
    finish: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldMark:
    """What lies flat on a part's or a post's top face, in the part's frame."""

    name: str  # "die.pad", "plate.post.cross"
    on: str  # body that carries it: "die", "plate.post"
    outline: WorldOutline  # in the part's frame; pads apart are rings of one
    reflectance: float  # of it


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldHole:
    """A round hole of a part that can receive a post, in the part's frame."""

    name: str  # "gear.bore"
    center_um: tuple[float, float]  # of its circle
    radius_um: float  # of its circle


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldPart:
    """A body: its prism, posts, holes and where it starts on the stage."""

    name: str  # as in the task
    outline: WorldOutline  # in the part's frame
    thickness_um: float  # height of the prism
    reflectance: float  # of its top face
    profile_tolerance_um: float  # hard limit of the edge offset, per side
    posts: tuple[WorldPost, ...]  # on its top face
    holes: tuple[WorldHole, ...]  # round ones that can receive a post
    start: Pose  # on the stage at reading 0
    theta_any: bool  # whether any angle is as likely
    sigma_xy_um: float  # of the start, per axis
    sigma_theta_rad: float  # of the start
    marks: tuple[WorldMark, ...] = ()  # on its top face and on its posts'
    # of the walls, least and most; 0: black
    wall_reflectance: tuple[float, float] = (0.0, 0.0)
    # share of the top face's light that a mirror gives back, least and most
    finish: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldTool:
    """Tweezers: fingers in the grip's frame with the jaws closed."""

    name: str  # as in the workcell
    left: WorldOutline  # finger that opens to -x
    right: WorldOutline  # finger that opens to +x
    thickness_um: float  # height of the fingers
    reflectance: float  # of their top face
    opening_um: tuple[float, float]  # smallest and largest
    start_opening_um: float  # before step 1
    stick_probability: float  # that a released part follows a finger
    # of the walls, least and most; 0: black
    wall_reflectance: tuple[float, float] = (0.0, 0.0)
    # share of the top face's light that a mirror gives back, least and most
    finish: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldAxes:
    """One axis group: spreads are one sigma."""

    start: AxisMove  # readings before step 1
    repeatability_xy_um: float  # of x and y each
    repeatability_z_um: float  # of z
    repeatability_theta_rad: float  # of the angle
    limits: Mapping[str, tuple[float, float]]  # least and greatest reading by axis
    speed_xy_um_per_s: float  # of x and y
    speed_z_um_per_s: float  # of z
    speed_theta_rad_per_s: float  # of the angle
    settle_s: float  # wait after each motion


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldLens:
    """Systematic errors of the lens as stated, and one sigma of what is not known.

    By the defocus of a point, its height less the focus, not by the focus travel.
    """

    distortion: float = 0.0  # radial, relative at the field's corner
    distortion_sigma: float = 0.0  # what is not known of it
    # shift of the image per um of defocus
    lateral_um_per_um: tuple[float, float] = (0.0, 0.0)
    scale_per_um: float = 0.0  # relative scale per um of defocus
    scale_sigma_per_um: float = 0.0  # what is not known of it
    field_curvature_per_um: float = 0.0  # 1 / R of the curved field
    field_curvature_sigma_per_um: float = 0.0  # what is not known of it


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldOptics:
    """Microscope and camera."""

    magnification: tuple[float, float]  # range of the zoom
    apertures: tuple[tuple[float, float], ...]  # magnification, aperture; ascending
    wavelength_um: float  # mean, in vacuum
    medium_index: float  # of the object-space medium
    pitch_um: float  # of the sensor's pixels
    width_px: int  # columns of a frame
    height_px: int  # rows of a frame
    fill_factor: float  # share of a pixel that sees light
    bits: int  # of a pixel's value
    full_well_e: float  # electrons at full scale
    read_noise_e: float  # rms of the readout
    zoom_time_s: float  # of one change
    parcentric_sigma_um: float  # jump of the image per change
    scale_sigma: float  # relative error of the magnification
    focus_um: tuple[float, float]  # lowest and highest
    focus_time_s: float  # of one move
    focus_repeatability_um: float  # one sigma
    lateral_sigma_um_per_um: float  # sideways shift per um of focus travel
    frame_time_s: float  # of exposure and readout
    light: tuple[float, float]  # least and most level
    light_gradient: float  # relative change across the field
    lens: WorldLens = WorldLens()  # systematic errors
    lamp_share: float = 0.0  # of coaxial light's aperture in the lens'; 0: other light
    light_kind: LightKind = "coaxial"  # through the lens, from around it or from below
    # share of full scale and the count it gives, rising; (): in proportion
    response: tuple[tuple[float, float], ...] = ()
    # count, and its variance with rounding, in place of electrons' noise
    noise: tuple[tuple[float, float], ...] = ()
    pattern_gain: float = 0.0  # one sigma of pixels' gain
    pattern_counts: float = 0.0  # one sigma of pixels' offset
    # one sigma of pictures about images, which stays from frame to frame
    discrepancy_edge: float = 0.0  # of the step at an edge
    discrepancy_flat: float = 0.0  # of the light, smooth
    discrepancy_pixel: float = 0.0  # of the picture's contrast, white
    wavefront: tuple[tuple[int, float], ...] = ()  # Noll index, waves rms
    halo_radius_um: float = 0.0  # one sigma
    halo_share: float = 0.0  # of all light


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """Everything the simulated cell contains."""

    name: str  # of the task
    optics: WorldOptics  # microscope and camera
    stage: WorldAxes  # its axes
    stage_datum_z_um: float  # world height of its surface at reading 0
    stage_reflectance: float  # of its surface
    stage_theta_axis_um: tuple[float, float]  # world point at reading 0
    stage_tilt_sigma_rad: float  # of its z axis
    stage_drift_um_per_min: float  # in a direction of the run's own
    robot: WorldAxes  # its axes
    robot_theta_axis_to_tip_um: float  # by which an error of its angle swings the tips
    parts: tuple[WorldPart, ...]  # by name
    tools: tuple[WorldTool, ...]  # by name

    @property
    def outlines(self) -> dict[str, WorldOutline]:
        """Return the outline of every body by its name in a scene, in its frame."""
        found: dict[str, WorldOutline] = {}
        for part in self.parts:
            found[part.name] = part.outline
            found.update({post.name: post.outline for post in part.posts})
            found.update({mark.name: mark.outline for mark in part.marks})
        for tool in self.tools:
            found[f"{tool.name}.left"] = tool.left
            found[f"{tool.name}.right"] = tool.right
        return found
