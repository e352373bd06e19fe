"""The microscope and camera that a picture is taken with."""

from __future__ import annotations

import math
from dataclasses import dataclass

ABERRATIONS = range(5, 23)  # Noll's numbers: past defocus, as far as edges are sampled


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelWindow:
    """A part of the frame, px; (0, 0) is the frame's top left pixel."""

    row: int
    column: int
    rows: int
    columns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueLensErrors:
    """What the lens does wrong, by the defocus of a point: its height less the focus.

    A point (x, y), r off the axis, at defocus z appears at (1 + scale_per_um z) (x, y)
    + z (lateral_x, lateral_y); what appears at radius r moves on by the share
    distortion (r / R)**2, R half the field's diagonal; best focus at r lies
    field_curvature_per_um r**2 / 2 higher.
    """

    distortion: float = 0.0  # relative, at the field's corner
    lateral_x: float = 0.0  # um per um of defocus
    lateral_y: float = 0.0  # um per um of defocus
    scale_per_um: float = 0.0  # relative scale per um of defocus
    field_curvature_per_um: float = 0.0  # 1 / R of the curved field


@dataclass(frozen=True, slots=True, kw_only=True)
class Halo:
    """Light that the lens scatters around each point of the object, a Gaussian."""

    radius_um: float = 0.0  # one sigma, in the object
    share: float = 0.0  # of all light

    def __post_init__(self) -> None:
        if not (self.radius_um >= 0 and 0 <= self.share < 1):  # also refuses nan
            raise ValueError(f"no halo has {self.radius_um} um and {self.share}")


@dataclass(frozen=True, slots=True, kw_only=True)
class LampLevel:
    """Brightness level (1 + gradient_x x / width + gradient_y y / height), y up."""

    level: float = 1.0
    gradient_x: float = 0.0
    gradient_y: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ImagingView:
    """One setting of lens, light and camera."""

    aperture: float  # numerical aperture, object side
    wavelength_um: float  # mean, in vacuum
    medium_index: float = 1.0  # of the object-space medium
    magnification: float
    pitch_um: float  # of the sensor's pixels
    width_px: int  # columns of the frame
    height_px: int  # rows of the frame
    fill_factor: float = 1.0  # share of a pixel that sees light
    focus_um: float  # world height in focus
    lamp_share: float = 0.0  # of coaxial light's aperture in the lens'; 0: other light
    shift_um: tuple[float, float] = (0.0, 0.0)  # of the whole image, in the object
    errors: TrueLensErrors = TrueLensErrors()
    lamp: LampLevel = LampLevel()
    wavefront: tuple[tuple[int, float], ...] = ()  # Noll index, waves rms
    halo: Halo = Halo()

    def __post_init__(self) -> None:
        if not 0 < self.aperture < self.medium_index:  # also refuses nan
            raise ValueError(f"the aperture {self.aperture} is not below the index")
        for name in ("wavelength_um", "magnification", "pitch_um", "fill_factor"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for noll, waves in self.wavefront:
            if not (noll in ABERRATIONS and math.isfinite(waves)):
                raise ValueError(f"Noll {noll} of {waves} waves is no aberration here")

    @property
    def px_per_um(self) -> float:
        """Return pixels per um of the object."""
        return self.magnification / self.pitch_um

    @property
    def steepest(self) -> float:
        """Return the slope of the marginal ray, um sideways per um of height."""
        return self.aperture / math.sqrt(self.medium_index**2 - self.aperture**2)

    @property
    def half_diagonal_um(self) -> float:
        """Return half the field's diagonal."""
        return math.hypot(self.width_px, self.height_px) / 2 / self.px_per_um


@dataclass(frozen=True, slots=True, kw_only=True)
class RaySampling:
    """How finely a picture is sampled; the defaults keep within .001 rms."""

    rays: int = 480  # through the pupil
    least_rays: int = 240  # where the picture is large
    lamp_rays: int = 480  # through the lamp, from each lit point
    turn_rad: float = 0.0  # of the pupil's pattern: another one, another sampling error
    fine_um: float = 0.2  # grid of the sharp plane, at most a seventh of lambda / A
    spacing: float = 0.2  # of a lattice, by the blur of what lies above or below
    least_spacing_um: float = 2.0  # of a lattice
    plane_spacing_um: float = 2.0  # of the sharp plane's lattice
    edge_um: float = 1.0  # between points of the plane where light bends, at least
    tolerance: float = 0.01  # of full scale: what bends by less is straight
    most_spacing_um: float = 8.0  # of other lattices
