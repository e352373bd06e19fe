"""Pictures of a part by Abbe's sum over a condenser, made without sight of optics.

The spectrum of a sharp mask of amplitudes is known in closed form; the pupil filters it
as each point of the source sees it, and the squares add up. That is done once for a
setting: light has a band limit, so the part is moved to its places by phases.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy import fft
from shapely import get_coordinates
from shapely.geometry import Polygon
from shapely.geometry.polygon import orient
from skimage.io import imsave

from tests.planner.calibration.twin_series import LENS, SIZE, UM_PER_PX
from validation.twins.camera import Camera, exposed
from validation.twins.optics import Complexes, Optics, pupil
from validation.twins.scenes import Floats

_FINER, _MARGIN = 2, 16  # points a side of a pixel; px around the picture
_POINTS = 140  # of the source: images change by 3e-4 of a step to 400
CAMERA = Camera(gain=1.02, read_noise=1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class CondenserShot:
    """A row of a table: a setting, true over the objective's and as read; a place."""

    coherence: float
    reading: float
    at_um: tuple[float, float] = (0.0, 0.0)
    group: str = ""


@dataclass(frozen=True, slots=True)
class CondenserRig:
    """A polygon on a dark stage, a lens and a camera."""

    shape: Polygon
    aperture: float = LENS.aperture
    wavelength_um: float = LENS.wavelength_um
    camera: Camera = CAMERA
    faces: tuple[float, float] = (0.8, 0.1)  # reflectances of part and stage
    defocus_um: float = 0.0
    zernike: tuple[tuple[int, float], ...] = ()  # Noll: waves rms

    @property
    def lens(self) -> Optics:
        """Return the lens in focus of the stage."""
        return Optics(
            aperture=self.aperture,
            wavelength_um=self.wavelength_um,
            zernike=dict(self.zernike),
        )


def frequencies() -> tuple[Floats, Floats]:
    """Return u (1, columns) and v (rows, 1) of the points, cycles/um, v up."""
    step = UM_PER_PX / _FINER
    rows, columns = (_FINER * (n + 2 * _MARGIN) for n in SIZE)
    return fft.fftfreq(columns, step)[None, :], -fft.fftfreq(rows, step)[:, None]


def shape_spectrum(shape: Polygon, u: Floats, v: Floats) -> Complexes:
    """Return the integral of exp(-2 pi i (u x + v y)) over a polygon, um^2."""
    kx, ky = 2 * np.pi * u, 2 * np.pi * v
    found = np.zeros(np.broadcast_shapes(u.shape, v.shape), np.complex128)
    whole = orient(shape)  # the body lies to the left of every edge
    for line in (whole.exterior, *whole.interiors):
        points = get_coordinates(line)
        for (x0, y0), (x1, y1) in pairwise(points):
            ex, ey, x, y = x1 - x0, y1 - y0, (x0 + x1) / 2, (y0 + y1) / 2
            along = np.sinc((kx * ex + ky * ey) / (2 * np.pi))
            found += (kx * ey - ky * ex) * along * np.exp(-1j * (kx * x + ky * y))
    square = kx**2 + ky**2
    square[0, 0] = 1.0
    found *= 1j / square
    found[0, 0] = shape.area
    return found


def source(radius: float) -> Iterator[tuple[float, float]]:
    """Yield points evenly over a disc, on a spiral: their mean square is the disc's."""
    for k in range(_POINTS):
        r, angle = radius * math.sqrt((k + 0.5) / _POINTS), k * math.pi * (3 - 5**0.5)
        yield r * math.cos(angle), r * math.sin(angle)


@cache
def light_spectrum(rig: CondenserRig, coherence: float) -> Complexes:
    """Return the spectrum of a picture's light, the part's origin at its middle."""
    u, v = frequencies()
    own, around = np.sqrt(rig.faces)
    size_um2 = u.size * v.size * (UM_PER_PX / _FINER) ** 2
    field = (own - around) * shape_spectrum(rig.shape, u, v) / size_um2
    field[0, 0] += around
    light, through = np.zeros(field.shape), 0.0
    lens = rig.lens
    for p, q in source(coherence * lens.aperture / lens.wavelength_um):
        seen = pupil(lens, u + p, v + q, rig.defocus_um)
        light += np.abs(fft.ifft2(field * seen, norm="forward")) ** 2
        through += float(np.abs(seen[0, 0]) ** 2)
    square = np.sinc(u * UM_PER_PX) * np.sinc(v * UM_PER_PX)
    return np.asarray(fft.fft2(light / through, norm="forward") * square)


def light_at(rig: CondenserRig, coherence: float, at_um: tuple[float, float]) -> Floats:
    """Return the light (rows, columns) of a picture, the part's origin at a place."""
    u, v = frequencies()
    rows, columns = SIZE
    # from the first point, a pixel's centre, to the part's origin
    x = at_um[0] + ((columns - 1) / 2 + _MARGIN) * UM_PER_PX
    y = at_um[1] - ((rows - 1) / 2 + _MARGIN) * UM_PER_PX
    turned = light_spectrum(rig, coherence) * np.exp(-2j * np.pi * (u * x + v * y))
    points = fft.ifft2(turned, norm="forward").real[::_FINER, ::_FINER]
    inner = points[_MARGIN : _MARGIN + rows, _MARGIN : _MARGIN + columns]
    return np.asarray(inner)


def write_condenser(
    folder: Path, rig: CondenserRig, shots: Sequence[CondenserShot], seed: int = 0
) -> Path:
    """Write a picture for each row, and the table beside them."""
    folder.mkdir(parents=True)
    lines = ["file,condenser_aperture,stage_x_um,stage_y_um,group"]
    for index, shot in enumerate(shots):
        rng = np.random.default_rng((seed, index))
        light = light_at(rig, shot.coherence, shot.at_um)
        counts = exposed(light, rig.camera, rng).astype(np.uint8)
        imsave(str(folder / f"{index:04d}.tif"), counts, check_contrast=False)
        place = f"{shot.at_um[0]},{shot.at_um[1]},{shot.group}"
        lines.append(f"{index:04d}.tif,{shot.reading},{place}")
    (folder / "readings.csv").write_text("\n".join(lines), encoding="utf-8")
    return folder
