"""A lens by its pupil: images of flat bodies in incoherent or partly coherent light.

Images are made on points that are `finer` to a pixel's side, on a plane that reaches
beyond the picture. What a pixel measures is the mean over its square.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy import fft

from validation.twins.scenes import Floats, Scene, Shape, coverage

Complexes = npt.NDArray[np.complex128]

_PER_NYQUIST = 2.0  # points, at least, for each that the cut-off asks for
_LEAST_POINTS = 640  # a side of the plane: the pupil is drawn this finely
_CELLS = 3  # a side of a point's share, odd: where bodies are drawn
_FEW = 9  # points of the source across its diameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Optics:
    """A lens and its light; lengths in um."""

    aperture: float  # numerical, of the objective
    wavelength_um: float
    index: float = 1.0
    focus_um: float = 0.0  # height of the plane in focus
    coherence: float | None = None  # condenser over objective; None: incoherent
    zernike: Mapping[int, float] = field(default_factory=dict)  # Noll: waves rms
    halo: tuple[float, float] | None = None  # sd of a Gaussian veil, um; its share


@dataclass(frozen=True, slots=True, kw_only=True)
class Plane:
    """The points that an image is made on."""

    size: tuple[int, int]  # rows, columns of the picture, px
    um_per_px: float
    finer: int  # points a side of a pixel
    margin: tuple[int, int]  # px beyond the picture, above and left as below and right

    @property
    def step_um(self) -> float:
        """Return the distance of points."""
        return self.um_per_px / self.finer

    @property
    def points(self) -> tuple[int, int]:
        """Return rows and columns of points."""
        rows, columns = (
            self.finer * (n + 2 * m)
            for n, m in zip(self.size, self.margin, strict=True)
        )
        return rows, columns

    def frequencies(self) -> tuple[Floats, Floats]:
        """Return u (1, columns) and v (rows, 1), cycles/um, v along y that is up."""
        rows, columns = self.points
        u = fft.fftfreq(columns, self.step_um)[None, :]
        return u, -fft.fftfreq(rows, self.step_um)[:, None]

    def square(self) -> Floats:
        """Return the transfer of a mean over a point's square, (rows, columns)."""
        u, v = self.frequencies()
        found: Floats = np.sinc(u * self.step_um) * np.sinc(v * self.step_um)
        return found

    def drawing(self) -> Floats:
        """Return the transfer of what `thinned` leaves of cells, (rows, columns)."""
        found = self.square()
        for each in self.frequencies():
            phase = 2 * np.pi * each * self.step_um / _CELLS
            found = found * (1 + 2 * np.cos(phase)) / 3
        return found

    def pixels(self, points: Floats) -> Floats:
        """Return means over the picture's pixels, (rows, columns)."""
        (rows, columns), (down, across), n = self.size, self.margin, self.finer
        inner = points[
            down * n : (down + rows) * n, across * n : (across + columns) * n
        ]
        found: Floats = inner.reshape(rows, n, columns, n).mean(axis=(1, 3))
        return found


def plane_of(
    optics: Optics, size: tuple[int, int], um_per_px: float, blur_um: float = 0.0
) -> Plane:
    """Return points that are dense and reach far enough; `blur_um` is defocus."""
    cutoff = 2 * optics.aperture / optics.wavelength_um
    finer = max(1, math.ceil(um_per_px * 2 * cutoff * _PER_NYQUIST))
    slope = optics.aperture / math.sqrt(optics.index**2 - optics.aperture**2)
    reach = 6 * optics.wavelength_um / optics.aperture + 1.5 * abs(blur_um) * slope
    if optics.halo is not None:
        reach += 3 * optics.halo[0]
    least = _LEAST_POINTS if optics.coherence is None else 0
    rows, columns = (_margin(n, finer, reach / um_per_px, least) for n in size)
    return Plane(size=size, um_per_px=um_per_px, finer=finer, margin=(rows, columns))


def _margin(pixels: int, finer: int, reach: float, least: int) -> int:
    """Return the margin, px, whose plane is quick to transform."""
    margin = max(math.ceil(reach), math.ceil((least / finer - pixels) / 2))
    while fft.next_fast_len(n := finer * (pixels + 2 * margin)) != n:
        margin += 1
    return margin


def zernike(noll: int, radius: Floats, angle: Floats) -> Floats:
    """Return Noll's polynomial of that index, rms 1 over the disc of radius 1."""
    n = int((math.sqrt(8 * noll - 7) - 1) / 2)
    place = noll - n * (n + 1) // 2  # 1..n+1 within the order
    m = 2 * ((place + n % 2) // 2) - n % 2
    found = np.zeros_like(radius)
    for k in range((n - m) // 2 + 1):
        below = math.factorial((n + m) // 2 - k) * math.factorial((n - m) // 2 - k)
        factor = (-1) ** k * math.factorial(n - k) / (math.factorial(k) * below)
        found += factor * radius ** (n - 2 * k)
    if m == 0:
        return math.sqrt(n + 1) * found
    turn = np.cos(m * angle) if noll % 2 == 0 else np.sin(m * angle)
    return np.asarray(math.sqrt(2 * (n + 1)) * found * turn)


def pupil(optics: Optics, u: Floats, v: Floats, z_um: float) -> Complexes:
    """Return the pupil at frequencies, cycles/um, for a body at a height.

    The field in focus is the body's, carried back by z - focus: the phase is exact,
    not that of a parabola. Zernikes count as exp(+2 pi i waves).
    """
    scale = optics.wavelength_um / optics.aperture
    r2, across = (u**2 + v**2) * scale**2, optics.index / optics.wavelength_um
    inside = r2 <= 1
    along = np.sqrt(np.maximum(across**2 - u**2 - v**2, 0))
    waves = -(z_um - optics.focus_um) * (along - across)
    r, angle = np.sqrt(r2 * inside), np.arctan2(v, u)
    for noll, rms in optics.zernike.items():
        waves = waves + rms * zernike(noll, r, angle)
    return np.asarray(inside * np.exp(2j * np.pi * waves))


def transfer(optics: Optics, plane: Plane, z_um: float = 0.0) -> Complexes:
    """Return the incoherent transfer at a plane's frequencies, 1 at none."""
    spread = np.abs(fft.ifft2(pupil(optics, *plane.frequencies(), z_um))) ** 2
    found = fft.fft2(spread)
    return np.asarray(found / found[0, 0])


def image(
    scene: Scene,
    optics: Optics,
    size: tuple[int, int],
    um_per_px: float,
    finer: int = 8,
) -> Floats:
    """Return light (rows, columns) px, where a white mirror returns 1.

    `finer` is the points a side of each cell that bodies are sampled at.
    """
    blur = max((abs(b.z_um - optics.focus_um) for b in scene.bodies), default=0.0)
    plane = plane_of(optics, size, um_per_px, blur)
    make = _incoherent if optics.coherence is None else _coherent
    spectrum = make(scene, optics, plane, finer) * plane.square()
    if optics.halo is not None:
        u, v = plane.frequencies()
        radius, share = optics.halo
        veil = np.exp(-2 * np.pi**2 * radius**2 * (u**2 + v**2))
        spectrum = spectrum * (1 - share + share * veil)
    return plane.pixels(np.asarray(fft.ifft2(spectrum).real))


def _drawn(shape: Shape, plane: Plane, finer: int) -> Complexes:
    """Return the spectrum of a shape itself: what drawing it in cells does, undone."""
    rows, columns = plane.points
    size = rows * _CELLS, columns * _CELLS
    cells = coverage(shape, size, plane.step_um / _CELLS, finer)
    return np.asarray(fft.fft2(thinned(thinned(cells).T).T)) / plane.drawing()


def thinned(cells: Floats) -> Floats:
    """Return cells (rows, n) as points (rows / _CELLS, n), by weights 1 2 3 2 1.

    A mean over one cell's row alone would let detail beyond the grid's reach fold back.
    """
    around = np.pad(cells, ((1, 1), (0, 0)))
    found = np.zeros((cells.shape[0] // _CELLS, cells.shape[1]))
    for shift, weight in enumerate((1, 2, 3, 2, 1)):
        found += weight / 9 * around[shift : shift + cells.shape[0] : _CELLS]
    return found


def _incoherent(scene: Scene, optics: Optics, plane: Plane, finer: int) -> Complexes:
    """Return the spectrum of the light, each height by its own transfer."""
    total = np.zeros(plane.points, np.complex128)
    total[0, 0] = scene.background * total.size
    for height in sorted({body.z_um for body in scene.bodies}):
        layer = np.zeros(plane.points, np.complex128)
        for body in scene.bodies:
            if body.z_um == height:
                excess = body.reflectance - scene.background
                layer += excess * _drawn(body.shape, plane, finer)
        total += layer * transfer(optics, plane, height)
    return total


def _coherent(scene: Scene, optics: Optics, plane: Plane, finer: int) -> Complexes:
    """Return the spectrum of the light, summed over points of the source (Abbe)."""
    heights = {body.z_um for body in scene.bodies}
    if len(heights) > 1:
        raise ValueError("partly coherent light needs bodies at one height")
    height = heights.pop() if heights else 0.0
    around = math.sqrt(scene.background)
    field_ = np.zeros(plane.points, np.complex128)
    field_[0, 0] = around * field_.size
    for body in scene.bodies:
        excess = math.sqrt(body.reflectance) - around
        field_ += excess * _drawn(body.shape, plane, finer)
    u, v = plane.frequencies()
    light, through = np.zeros(plane.points), 0.0
    for p, q in _source(optics):
        seen = pupil(optics, u + p, v + q, height)
        light += np.abs(fft.ifft2(field_ * seen)) ** 2
        through += float(np.abs(seen[0, 0]) ** 2)
    return np.asarray(fft.fft2(light / through))


def _source(optics: Optics) -> Iterator[tuple[float, float]]:
    """Yield the frequencies, cycles/um, of points evenly all over the source."""
    if not optics.coherence:
        yield 0.0, 0.0
        return
    full = optics.coherence * optics.aperture / optics.wavelength_um
    axis = np.linspace(-1, 1, _FEW + 1)[:-1] + 1 / _FEW
    for p in axis:
        for q in axis:
            if math.hypot(p, q) <= 1:
                yield float(p * full), float(q * full)
