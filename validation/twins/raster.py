"""Polygons at a pose as coverage of points, and a lens that blurs them.

Pixel (row, column) has its centre at x = (column - (columns - 1) / 2) pitch and
y = ((rows - 1) / 2 - row) pitch, um; y is up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

Floats = npt.NDArray[np.float64]

_PUPIL = 512  # points across the plane of frequencies that a pupil is drawn in
_BEYOND = 2.2  # half of that plane, in radii of the pupil: the transfer ends at 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Pixels, and how many points each is made of."""

    rows: int
    columns: int
    um_per_px: float
    finer: int = 4  # points a side of a pixel

    @property
    def step_um(self) -> float:
        """Return the distance of points."""
        return self.um_per_px / self.finer

    def axes_um(self) -> tuple[Floats, Floats]:
        """Return x of columns of points, and y of rows of them."""
        across, down = self.columns * self.finer, self.rows * self.finer
        x = (np.arange(across) - (across - 1) / 2) * self.step_um
        y = ((down - 1) / 2 - np.arange(down)) * self.step_um
        return np.asarray(x, np.float64), np.asarray(y, np.float64)

    def pixels(self, points: Floats) -> Floats:
        """Return means over pixels, (rows, columns), of values of points."""
        shape = (self.rows, self.finer, self.columns, self.finer)
        found: Floats = points.reshape(shape).mean(axis=(1, 3))
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Where a part lies: x, y um and its angle, counter-clockwise."""

    x_um: float = 0.0
    y_um: float = 0.0
    theta_rad: float = 0.0

    def apply(self, points: Floats) -> Floats:
        """Return points (N, 2) of the part in the world."""
        c, s = np.cos(self.theta_rad), np.sin(self.theta_rad)
        turned: Floats = points @ np.array([[c, s], [-s, c]])
        return turned + (self.x_um, self.y_um)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """A lens in incoherent light."""

    aperture: float
    wavelength_um: float
    index: float = 1.0
    defocus_um: float = 0.0  # of the part, above the plane in focus
    # rms waves by name: "spherical", "coma" along x, "astigmatism" along x
    waves: Mapping[str, float] = field(default_factory=dict)


def coverage(rings: Sequence[Floats], grid: Grid) -> Floats:
    """Return what rings cover of each point's cell along its row, 0..1.

    Exact along x where an edge crosses a row's middle, by the even-odd rule: a ring
    within another is a hole. Rings are (N, 2) um, closed without repeating a point.
    """
    x, y = grid.axes_um()
    left, step = x[0] - grid.step_um / 2, grid.step_um
    found = np.zeros((y.size, x.size))
    for row, height in enumerate(y):
        at = np.sort(np.concatenate([_crossings(ring, height) for ring in rings]))
        for start, end in zip(at[::2], at[1::2], strict=True):
            edges = np.clip(np.array([start, end]) - left, 0, step * x.size) / step
            found[row] += np.clip(np.arange(1, x.size + 1) - edges[0], 0, 1)
            found[row] -= np.clip(np.arange(1, x.size + 1) - edges[1], 0, 1)
    return found


def _crossings(ring: Floats, y_um: float) -> Floats:
    """Return x where a ring's edges cross a height."""
    x0, y0 = ring.T
    x1, y1 = np.roll(ring, -1, axis=0).T
    some = (y0 > y_um) != (y1 > y_um)
    along = (y_um - y0[some]) / (y1[some] - y0[some])
    found: Floats = x0[some] + along * (x1[some] - x0[some])
    return found


def transfer(lens: Lens, grid: Grid) -> npt.NDArray[np.complex128]:
    """Return the lens' transfer at the frequencies of a grid's points.

    (rows, columns) of points, as `numpy.fft` orders them: the transform of the squared
    modulus of the pupil's transform.
    """
    plane = _BEYOND * lens.aperture / lens.wavelength_um  # cycles/um, half of it
    step = 2 * plane / _PUPIL
    axis = np.asarray((np.arange(_PUPIL) - _PUPIL // 2) * step, np.float64)
    spread = np.abs(np.fft.ifft2(np.fft.ifftshift(_pupil(lens, axis)))) ** 2
    table = np.fft.fftshift(np.fft.fft2(spread))
    middle = _PUPIL // 2
    table /= table[middle, middle]
    rows, columns = grid.rows * grid.finer, grid.columns * grid.finer
    v = -np.fft.fftfreq(rows, grid.step_um)  # rows go down, y up
    u = np.fft.fftfreq(columns, grid.step_um)
    at = np.meshgrid(v / step + middle, u / step + middle, indexing="ij")
    real, imaginary = (map_coordinates(part, at, order=3) for part in
                       (table.real, table.imag))  # fmt: skip
    return np.asarray(real + 1j * imaginary)


def _pupil(lens: Lens, axis: Floats) -> npt.NDArray[np.complex128]:
    """Return the pupil over frequencies `axis` squared, cycles/um."""
    u, v = np.meshgrid(axis, axis)
    r2 = (u**2 + v**2) * (lens.wavelength_um / lens.aperture) ** 2
    up = np.sqrt(np.maximum((lens.index / lens.wavelength_um) ** 2 - u**2 - v**2, 0))
    r, angle = np.sqrt(r2), np.arctan2(v, u)
    shapes = {  # rms 1 over the pupil
        "spherical": np.sqrt(5) * (6 * r2**2 - 6 * r2 + 1),
        "coma": np.sqrt(8) * (3 * r**3 - 2 * r) * np.cos(angle),
        "astigmatism": np.sqrt(6) * r2 * np.cos(2 * angle),
    }
    waves = lens.defocus_um * up + sum(
        (amount * shapes[name] for name, amount in lens.waves.items()), np.zeros(())
    )
    return np.asarray((r2 <= 1) * np.exp(2j * np.pi * waves))


def blurred(points: Floats, lens: Lens, grid: Grid) -> Floats:
    """Return values of points as the lens shows them."""
    spectrum = np.fft.fft2(points) * transfer(lens, grid)
    return np.asarray(np.fft.ifft2(spectrum).real)
