"""Abbe's image formation: amplitudes of one source point after the other, squared."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import fft

from microplan.arrays import ComplexArray, FloatArray
from microplan.optics.coherence.source import LightSource
from microplan.optics.render.spectrum import Spectrum, Tile
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.zernike import terms_on_grid


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmissionSheet:
    """The bodies of one height on a tile; coefficients run from -K to K and -J to J."""

    z_um: float  # above the plane in focus
    cover: ComplexArray  # (2 K + 1, 2 J + 1), of the indicator
    amplitude: ComplexArray  # same, of the indicator times the root of the reflectance


def centred(values: ComplexArray) -> ComplexArray:
    """Return the orders (2 K + 1, 2 J + 1) of values (2 K + 1, J + 1), dimensionless.

    Values are those of a `Spectrum`; orders run from -K to K and from -J to J.
    """
    J, K = values.shape[1] - 1, values.shape[0] // 2
    found = np.empty((2 * K + 1, 2 * J + 1), dtype=np.complex128)
    found[:, J:] = np.roll(values, K, axis=0)
    found[:, :J] = np.conj(found[::-1, :J:-1])
    return found


def band_per_um(tile: Tile, microscope: Microscope, coherence: float) -> float:
    """Return how far `intensity` reads the coefficients of its sheets, cycles/um."""
    reach = max(1 + coherence, 2.0) * microscope.cutoff_per_um / 2
    return reach + 2 / min(tile.width_um, tile.height_um)  # whole orders about it


def intensity(
    sheets: list[TransmissionSheet],
    background: float,
    tile: Tile,
    microscope: Microscope,
    source: LightSource,
) -> Spectrum:
    """Return the coefficients of an image's intensity, without the camera.

    Parameters
    ----------
    sheets : list of TransmissionSheet
        From the lowest to the highest; at least one.
    background : float
        Amplitude of the uniform plane below, at the height of the lowest sheet.

    Returns
    -------
    Spectrum
        Up to the incoherent cutoff along x and along y.

    Notes
    -----
    Fields go as exp(i k z) upwards, to the lens: that of a body at z > 0, carried to
    the plane in focus, has the phase of `microplan.optics.transfer.wavefront`.
    """
    grid = _OrderGrid.of(tile, microscope)
    masks = [1 - grid.cover(s, microscope) for s in sheets[1:]]
    total = np.zeros(grid.shape)
    for sx, sy, weight in zip(source.x, source.y, source.weight, strict=True):
        look = _SourcePoint.of(grid, microscope, float(sx), float(sy))
        field = look.first(grid, sheets[0], background)
        for sheet, mask in zip(sheets[1:], masks, strict=True):
            field = look.pass_by(grid, field, sheet, mask)
        image = grid.transform(look.through_lens(field))
        total += weight * (image.real**2 + image.imag**2)
    return Spectrum(tile=tile, values=grid.orders(total))


@dataclass(frozen=True, slots=True, kw_only=True)
class _OrderGrid:
    """Points that hold a squared amplitude whose orders reach J and K."""

    tile: Tile
    J: int
    K: int
    shape: tuple[int, int]  # over 4 K, over 4 J: squares and masked fields do not fold

    @classmethod
    def of(cls, tile: Tile, microscope: Microscope) -> _OrderGrid:
        """Return the grid of a tile; the pupil's rim is within J and K."""
        radius = microscope.cutoff_per_um / 2
        J = math.floor(radius * tile.width_um) + 1
        K = math.floor(radius * tile.height_um) + 1
        return cls(tile=tile, J=J, K=K, shape=(_fast(4 * K + 1), _fast(4 * J + 1)))

    def block(self, values: ComplexArray, k: int, j: int, times: int) -> ComplexArray:
        """Return coefficients to `times` K and J about an order; 0 where none are."""
        rows, columns = times * self.K, times * self.J
        k0, j0 = values.shape[0] // 2 + k, values.shape[1] // 2 + j
        found = np.zeros((2 * rows + 1, 2 * columns + 1), dtype=np.complex128)
        top, left = max(rows - k0, 0), max(columns - j0, 0)
        part = values[
            max(k0 - rows, 0) : k0 + rows + 1, max(j0 - columns, 0) : j0 + columns + 1
        ]
        found[top : top + part.shape[0], left : left + part.shape[1]] = part
        return found

    def cover(self, sheet: TransmissionSheet, microscope: Microscope) -> FloatArray:
        """Return a sheet's indicator as far as it diffracts light within the pupil."""
        cutoff = microscope.cutoff_per_um
        block = self.block(sheet.cover, 0, 0, 2)
        u = np.arange(-2 * self.J, 2 * self.J + 1) / (self.tile.width_um * cutoff)
        v = np.arange(-2 * self.K, 2 * self.K + 1) / (self.tile.height_um * cutoff)
        block[np.hypot(u, v[:, None]) > 1] = 0
        found: FloatArray = self.transform(block).real
        return found

    def transform(self, block: ComplexArray) -> ComplexArray:
        """Return the field of a block, but for the carrier of its middle."""
        rows, columns = self.shape
        K, J = block.shape[0] // 2, block.shape[1] // 2
        tall = np.zeros((rows, block.shape[1]), dtype=np.complex128)
        tall[: K + 1], tall[rows - K :] = block[K:], block[:K]
        tall = fft.ifft(tall, axis=0, overwrite_x=True)
        wide = np.zeros((rows, columns), dtype=np.complex128)
        wide[:, : J + 1], wide[:, columns - J :] = tall[:, J:], tall[:, :J]
        field: ComplexArray = fft.ifft(wide, axis=1, overwrite_x=True)
        field *= rows * columns
        return field

    def back(self, field: ComplexArray) -> ComplexArray:
        """Return the block to K and J of a field, the inverse of `transform`."""
        found = fft.fft2(field) / field.size
        k, j = np.arange(-self.K, self.K + 1), np.arange(-self.J, self.J + 1)
        block: ComplexArray = found[k[:, None], j]
        return block

    def orders(self, image: FloatArray) -> ComplexArray:
        """Return an image's coefficients to twice K and J, as a `Spectrum` has them."""
        found = fft.rfft2(image) / image.size
        K, J = 2 * self.K, 2 * self.J
        values: ComplexArray = found[np.r_[0 : K + 1, -K:0], : J + 1]
        return values


@dataclass(frozen=True, slots=True, kw_only=True)
class _SourcePoint:
    """One source point: the orders that pass the pupil, and their phases."""

    order: tuple[int, int]  # (k, j) of the block's middle, near the pupil's
    pupil: npt.NDArray[np.bool_]  # (2 K + 1, 2 J + 1)
    path: FloatArray  # same: phase of a um of defocus, rad
    light: float  # the same for the illumination
    lens: ComplexArray | None  # (2 K + 1, 2 J + 1), of a wavefront error; None: without

    @classmethod
    def of(
        cls, grid: _OrderGrid, microscope: Microscope, sx: float, sy: float
    ) -> _SourcePoint:
        """Return the look of a source point, in radii of the pupil."""
        radius = microscope.cutoff_per_um / 2
        W, H = grid.tile.width_um, grid.tile.height_um
        j0, k0 = round(-sx * radius * W), round(-sy * radius * H)
        u = (np.arange(-grid.J, grid.J + 1) + j0) / (W * radius) + sx
        v = (np.arange(-grid.K, grid.K + 1) + k0) / (H * radius) + sy
        rho2 = u**2 + v[:, None] ** 2
        A, n = microscope.aperture, microscope.medium_index
        wave = 2 * np.pi / microscope.wavelength_um
        # n - sqrt(n**2 - a**2) as a quotient; light beyond grazing stays at grazing
        high = np.minimum(A**2 * rho2, n**2)
        low = min(A**2 * (sx**2 + sy**2), n**2)
        return cls(
            order=(k0, j0),
            pupil=rho2 <= 1,
            path=wave * (n - high / (n + np.sqrt(n**2 - high))),
            light=wave * (n - low / (n + math.sqrt(n**2 - low))),
            lens=_lens(microscope, u, v),
        )

    def first(
        self, grid: _OrderGrid, sheet: TransmissionSheet, background: float
    ) -> ComplexArray:
        """Return the block in the pupil from the lowest sheet and what lies below."""
        field = grid.block(sheet.amplitude, *self.order, 1)
        if background:
            field -= background * grid.block(sheet.cover, *self.order, 1)
            k, j = grid.K - self.order[0], grid.J - self.order[1]
            if 0 <= k <= 2 * grid.K and 0 <= j <= 2 * grid.J:  # the direct light
                field[k, j] += background
        return field * self._from(sheet.z_um)

    def pass_by(
        self,
        grid: _OrderGrid,
        field: ComplexArray,
        sheet: TransmissionSheet,
        mask: FloatArray,
    ) -> ComplexArray:
        """Return the block after a higher sheet has blocked and added its light."""
        turn = np.exp(-1j * sheet.z_um * self.path)
        there = grid.transform(field * turn.conj()) * mask
        # the field lacks the carrier of the block's middle, and so does what is left
        kept = grid.back(there) * turn * self.pupil
        own = grid.block(sheet.amplitude, *self.order, 1)
        passed: ComplexArray = kept + own * self._from(sheet.z_um)
        return passed

    def _from(self, z_um: float) -> ComplexArray:
        """Return what the pupil does to light that a sheet at a height sends back."""
        if z_um == 0:
            return self.pupil.astype(np.complex128)
        phase = -z_um * (self.path + self.light)
        turned: ComplexArray = self.pupil * np.exp(1j * phase)
        return turned

    def through_lens(self, field: ComplexArray) -> ComplexArray:
        """Return a block in the pupil as the lens' wavefront error leaves it."""
        return field if self.lens is None else field * self.lens


def _lens(microscope: Microscope, u: FloatArray, v: FloatArray) -> ComplexArray | None:
    """Return the phase factors of a wavefront error at u (J,) and v (K,) in radii."""
    if not microscope.wavefront:
        return None
    found: ComplexArray = np.exp(2j * np.pi * terms_on_grid(microscope.wavefront, u, v))
    return found


def _fast(least: int) -> int:
    """Return the next length that transforms fast."""
    size = fft.next_fast_len(least)
    if size is None:  # only if the length overflowed
        raise ValueError(f"no transform of length {least}")
    return size
