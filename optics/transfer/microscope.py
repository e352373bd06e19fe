"""Numbers of one optical setting: scale, blur, Airy radius, depth of field, cutoff."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

Terms = tuple[tuple[int, float], ...]  # Noll's index, waves rms over the pupil
Halo = tuple[float, float]  # um, the standard deviation of a Gaussian; share of light


@dataclass(frozen=True, slots=True, kw_only=True)
class Microscope:
    """One setting of the microscope: objective, zoom and camera."""

    aperture: float  # numerical aperture, object side [1]
    wavelength_um: float  # mean of the illumination, in vacuum
    medium_index: float  # of the object-space medium, 1 in air [1]
    magnification: float  # object to sensor [1]
    pitch_um: float  # distance of pixel centres on the sensor
    width_px: int
    height_px: int
    fill_factor: float = 1.0  # light-sensitive share of a pixel's area [1]
    # numerical aperture of a lamp below, beyond which rays are dark; None: all are lit
    lamp_aperture: float | None = None
    # what the lens' wavefront lacks of a sphere; an image in focus is where it was
    wavefront: Terms = ()
    halo: Halo | None = None  # into which glass and glue scatter a share of the light
    # side of the pixels in object space, um, by which large discs in focus are shown
    # where they are; None: of its own
    disc_side_um: float | None = None

    def __post_init__(self) -> None:
        names = ("aperture", "wavelength_um", "medium_index", "magnification")
        for name in (*names, "pitch_um", "width_px", "height_px", "fill_factor"):
            value = getattr(self, name)
            if not (value > 0 and math.isfinite(value)):  # also refuses nan
                raise ValueError(f"{name} must be positive and finite, got {value}")
        if not self.aperture < self.medium_index:
            raise ValueError(
                f"aperture must be below medium_index {self.medium_index}, "
                f"got {self.aperture}"
            )
        if self.lamp_aperture is not None and not self.lamp_aperture > 0:
            raise ValueError(f"lamp_aperture must be > 0, got {self.lamp_aperture}")
        if not all(math.isfinite(waves) for _, waves in self.wavefront):
            raise ValueError(f"wavefront must be finite, got {self.wavefront}")
        if self.halo is not None and not (self.halo[0] > 0 and 0 <= self.halo[1] < 1):
            raise ValueError(
                f"halo must be um > 0 and a share of 0..1, got {self.halo}"
            )
        side_um = self.disc_side_um
        if side_um is not None and not (side_um > 0 and math.isfinite(side_um)):
            raise ValueError(f"disc_side_um must be > 0, got {self.disc_side_um}")
        if self.fill_factor > 1:
            raise ValueError(f"fill_factor must be at most 1, got {self.fill_factor}")

    @property
    def cone_aperture(self) -> float:
        """Return the aperture of the rays that carry light, at most the lens'."""
        if self.lamp_aperture is None:
            return self.aperture
        return min(self.aperture, self.lamp_aperture)

    @property
    def px_per_um(self) -> float:
        """Return pixels per um in object space."""
        return self.magnification / self.pitch_um

    @property
    def um_per_px(self) -> float:
        """Return the pixel pitch in object space, um."""
        return self.pitch_um / self.magnification

    @property
    def side_um(self) -> float:
        """Return the side of a pixel's light-sensitive area in object space, um."""
        return self.um_per_px * math.sqrt(self.fill_factor)

    @property
    def shown_side_um(self) -> float:
        """Return that of the pixels by which discs in focus are where they are, um."""
        return self.disc_side_um or self.side_um

    @property
    def without_pixels(self) -> Microscope:
        """Return the lens without pixels and halo: images at all zooms share it."""
        return replace(
            self,
            magnification=1.0,
            pitch_um=1.0,
            width_px=1,
            height_px=1,
            fill_factor=1.0,
            halo=None,
            disc_side_um=None,
        )

    @property
    def halo_reach_um(self) -> float:
        """Return the radius that holds all but .2 % of a halo, um, 0 without one."""
        return 0.0 if self.halo is None else 3.5 * self.halo[0]

    @property
    def field_um(self) -> tuple[float, float]:
        """Return (width, height) of the field of view, um."""
        return (self.width_px * self.um_per_px, self.height_px * self.um_per_px)

    @property
    def cutoff_per_um(self) -> float:
        """Return the incoherent cutoff 2 A / wavelength, cycles/um in object space."""
        return 2 * self.aperture / self.wavelength_um

    @property
    def airy_radius_um(self) -> float:
        """Return the radius of the first dark ring in object space, um.

        This is the resolution; the paper quotes its diameter on the sensor, eq. (4).
        """
        return 0.61 * self.wavelength_um / self.aperture

    @property
    def wave_depth_um(self) -> float:
        """Return the depth over which |W20| stays below a quarter wave, um.

        Paraxial, n wavelength / A**2 from end to end; it replaces the paper's eq. (5).
        """
        return self.medium_index * self.wavelength_um / self.aperture**2

    @property
    def wave_depth_exact_um(self) -> float:
        """Return `wave_depth_um` with the exact phase of the marginal ray, um."""
        return self.wavelength_um / (2 * self._rim_sag)

    @property
    def _rim_sag(self) -> float:
        """Return n - sqrt(n**2 - A**2) as a quotient, which does not cancel."""
        n, A = self.medium_index, self.aperture
        return A**2 / (n + math.sqrt(n**2 - A**2))

    def rim_w20_um(self, z_um: float) -> float:
        """Return the defocus coefficient whose rim phase is exact, um.

        z A**2 / (n + sqrt(n**2 - A**2)), the one for `stokseth` and `hopkins`.
        """
        return z_um * self._rim_sag

    def paraxial_w20_um(self, z_um: float) -> float:
        """Return the paraxial defocus coefficient z A**2 / (2 n), um."""
        return z_um * self.aperture**2 / (2 * self.medium_index)

    def blur_diameter_um(self, z_um: float) -> float:
        """Return the blur circle of the marginal ray in object space, um, >= 0.

        2 |z| A / sqrt(n**2 - A**2) with the aperture of the lit rays; it replaces eqs.
        (2, 3) of the paper.
        """
        n, A = self.medium_index, self.cone_aperture
        return 2 * abs(z_um) * A / math.sqrt(n**2 - A**2)
