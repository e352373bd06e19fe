"""Sampling of an image: band, margin, transfer of pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.render.pruned_ifft import Samples
from microplan.optics.render.spectrum import Tile
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import RadialTable, find_model
from microplan.optics.transfer.otf import diffraction

_AT_ONCE = 1 << 14  # orders read at once: their cubics stay in the cache


@dataclass(frozen=True, slots=True, kw_only=True)
class Quadrant:
    """Places in radial tables of the orders 0..K, 0..J of a tile."""

    places: FloatArray  # (K + 1, J + 1) sqrt(1 - x); -1 beyond the cutoff

    @classmethod
    def of(cls, tile: Tile, orders: tuple[int, int], cutoff_per_um: float) -> Self:
        """Return the quadrant up to the highest orders (J, K)."""
        u = np.arange(orders[0] + 1) / (tile.width_um * cutoff_per_um)
        v = np.arange(orders[1] + 1) / (tile.height_um * cutoff_per_um)
        places = u**2 + v[:, None] ** 2
        np.subtract(1, np.sqrt(places, out=places), out=places)
        beyond = places < 0
        np.sqrt(np.maximum(places, 0, out=places), out=places)
        places[beyond] = -1
        return cls(places=places)

    def gain(
        self, table: RadialTable, orders: tuple[int, int], *, single: bool = False
    ) -> Samples:
        """Return a transfer up to orders (J, K).

        Parameters
        ----------
        orders : (J, K)
            At most those of the quadrant.
        single : bool
            Whether the cubics are evaluated in single precision: 2e-7 off.

        Returns
        -------
        (K + 1, J + 1) float array
            As `table.read`, but 0 beyond the table's largest frequency.
        """
        J, K = orders
        cubics: Samples = _cubics(table)
        if single:
            cubics = cubics.astype(np.float32)
        found: Samples = np.empty((K + 1, J + 1), dtype=cubics.dtype)
        step = max(1, _AT_ONCE // (J + 1))
        for first in range(0, K + 1, step):
            part = slice(first, min(first + step, K + 1))
            # below the table there is one step of zeros
            t = self.places[part, : J + 1] * (1 / table.step)
            t += 1 - table.first / table.step
            _read(cubics, np.maximum(t, 0, out=t), found[part])
        return found


def _read(cubics: Samples, t: FloatArray, out: Samples) -> None:
    """Write cubics (N, 4) at positions t >= 0 in steps into `out`, same shape as t.

    From the position in double precision: a single one would blur the phase of large
    defocus.
    """
    i = t.astype(np.intp)
    np.minimum(i, len(cubics) - 1, out=i)
    rest = np.subtract(t, i, out=t).astype(out.dtype)
    mine = cubics.take(i, axis=0)
    np.multiply(mine[..., 0], rest, out=out)
    for power in (1, 2):
        np.add(out, mine[..., power], out=out)
        np.multiply(out, rest, out=out)
    np.add(out, mine[..., 3], out=out)


def pixel_gain(
    microscope: Microscope, tile: Tile, orders: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Return the pixels' transfer [1] at orders along x (J + 1,) and y (K + 1,)."""
    side = microscope.side_um
    across = np.sinc(np.arange(orders[0] + 1) / tile.width_um * side)
    along = np.sinc(np.arange(orders[1] + 1) / tile.height_um * side)
    return across, along


def halo_gain(
    microscope: Microscope, tile: Tile, orders: tuple[int, int]
) -> FloatArray:
    """Return the transfer [1] of a lens' halo at orders, (K + 1, J + 1)."""
    radius_um, share = microscope.halo or (0.0, 0.0)
    waves = 2 * (np.pi * radius_um) ** 2
    across, along = (
        np.exp(-waves * (np.arange(most + 1) / side_um) ** 2)
        for most, side_um in zip(orders, (tile.width_um, tile.height_um), strict=True)
    )
    found: FloatArray = 1 - share + share * along[:, None] * across
    return found


def _cubics(table: RadialTable) -> FloatArray:
    """Return (N + 1, 4) cubics by shares of a step, zeros for one before the first."""
    steps = np.zeros((table.pieces.shape[1] + 1, 4))
    np.multiply(table.pieces.T, table.step ** np.arange(3, -1, -1), out=steps[1:])
    return steps


BAND_ERROR = 5e-4  # of unit contrast, what cutting the band may cost by `band_error`
# The edge response of an Airy pattern nears its end as (wavelength / A) / (pi**3 d):
# at 40 wavelength / A it is 8e-4 away from it, for an endless straight edge.
MARGIN = 40.0
NEAR = 10.0  # wavelengths / A, the part of the margin that a transform's period has
# What making up for it leaves, of unit contrast: seen 2.4e-5 at most for edges, corners
# and parts in and about frames of 160 to 640 pixels, in focus, where it is worst
# (tested).
FAR_ERROR = 3e-5
SINGLE_ERROR = 1e-6  # of unit contrast, what single precision adds (tested)
CUTS: FloatArray = np.geomspace(1e-6, 1.0, 1200)  # shares of the cutoff


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampling:
    """How much band and how much margin an image is computed with."""

    band_error: float = BAND_ERROR  # of unit contrast, what cutting the band may cost
    margin: float = MARGIN  # around all sources of light, in wavelengths / A
    single: bool = False  # transforms in single precision: `SINGLE_ERROR` more
    # the margin beyond it is made up for by `microplan.optics.render.far_field`
    near: float = NEAR
    # so many times closer than usual are points from which rays past walls are traced;
    # below 1 there are fewer rays of each, and past several bodies, too; with 0 there
    # are none, for differences of images that all get the same of them
    rays: float = 1.0
    # as `rays`, of the points alone from which walls are seen; None: as that says
    walls: float | None = None
    # for the many images of a look: layers may be read from planes, which are made once
    # for all poses, `microplan.optics.render.plane_reading`
    planes: bool = False

    def __post_init__(self) -> None:
        for name in ("band_error", "margin", "near", "rays", "walls"):
            value = getattr(self, name)
            may_be_none = name == "rays" and value == 0
            if value is None or may_be_none or 0 < value < math.inf:
                continue
            raise ValueError(f"{name} must be positive and finite, got {value}")

    @property
    def few_points(self) -> bool:
        """Return whether what is blurred widely may come from few points.

        In images that share planes, unless more of the band is asked for than usual.
        """
        return self.planes and self.band_error >= BAND_ERROR


# of layers that only images of few rays have: as rough as these
ROUGH = Sampling(band_error=2e-3, margin=12.0, near=12.0, single=True)


def margin_um(microscope: Microscope, z_um: float, margin: float = MARGIN) -> float:
    """Return how far light spreads sideways from a layer `z_um` out of focus, um.

    The radius of the marginal ray's blur circle, and `margin` wavelengths over A, or
    all of a halo if that is wider.
    """
    tail = margin * microscope.wavelength_um / microscope.aperture
    tail = max(tail, microscope.halo_reach_um)
    return microscope.blur_diameter_um(z_um) / 2 + tail


def margin_error(margin: float = MARGIN) -> float:
    """Return what the margin costs where an endless edge leaves the tile [1]."""
    return float(1 / (np.pi**3 * margin))


def band_error(model: str, microscope: Microscope, z_um: float) -> FloatArray:
    """Return what cutting the band costs, at the cuts of `CUTS`.

    Parameters
    ----------
    model : str
        A key of `microplan.optics.transfer.models.MODELS`.
    z_um : float
        Defocus of the layer.

    Returns
    -------
    (len(CUTS),) float64 array
        Predicted image error of unit contrast, falling. Three times the integral of
        the transfer over pi x beyond the cut: one edge costs the integral, and a
        corner or a narrow slot joins two or three. The transfer is replaced by its
        envelope: |jinc q| <= 1.6 q**-1.5, as 2 J1(q) / q <= 2 sqrt(2 / pi) q**-1.5.

    Notes
    -----
    A prediction for edges, corners and slots, no bound: in the middle of a circle what
    is cut off comes from all of the rim in phase and adds up, to 1.75 times the
    prediction for a disc of 2 um at 20 x (A .42, pixels of 7.5 um, 5e-3 asked for).
    Where that matters an image of all of the band decides, as in
    `microplan.optics.render.fidelity`.
    """
    found = find_model(model)
    # the smaller W20 of the two, and x (1 - x) for the product too: the safe side
    waves = abs(microscope.paraxial_w20_um(z_um)) / microscope.wavelength_um
    q = 8 * np.pi * waves * CUTS * (1 - CUTS if found.diffracts else 1.0)
    envelope = 1 / np.maximum(1.0, q**1.5 / 1.6)
    if found.diffracts:
        envelope = envelope * diffraction(CUTS)
    a = CUTS * microscope.cutoff_per_um * microscope.um_per_px
    a = a * np.sqrt(microscope.fill_factor)
    pixel = np.maximum(np.abs(np.sinc(a)), np.sinc(a / np.sqrt(2)) ** 2)
    terms = envelope * pixel
    steps = (terms[1:] + terms[:-1]) / 2 * np.diff(np.log(CUTS))
    beyond = np.concatenate([np.cumsum(steps[::-1])[::-1], [0.0]])
    total: FloatArray = 3 / np.pi * beyond
    return total


@lru_cache(maxsize=256)
def band_cut(
    model: str, microscope: Microscope, z_um: float, error: float = BAND_ERROR
) -> float:
    """Return the smallest share of the cutoff that costs `error` at most, 0..1."""
    cost = band_error(model, microscope, z_um)
    return float(CUTS[np.flatnonzero(cost <= error)[0]])
