"""Models of the defocus OTF by name, with their radial tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Self

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.transfer.lamp_limited import lamp_limited
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.node_refinement import refined
from microplan.optics.transfer.otf import exact, geometric, hopkins, product, stokseth

Curve = Callable[[FloatArray], FloatArray]  # x -> transfer

# What cubic interpolation errs by at most, as a transfer, up to z = 1e6 um and
# A = .999 n (`benchmarks/defocus/error_maps.py`), if a step changes the marginal ray's
# phase by:
TABLE_ERROR = 2e-5
_STEP_RAD = 0.36
_LEAST = 64  # steps


def _rim_waves(microscope: Microscope, z_um: float) -> float:
    return microscope.rim_w20_um(z_um) / microscope.wavelength_um


def _paraxial_waves(microscope: Microscope, z_um: float) -> float:
    return microscope.paraxial_w20_um(z_um) / microscope.wavelength_um


def _exact(microscope: Microscope, z_um: float) -> Curve:
    return lambda x: exact(
        x,
        z_um=z_um,
        aperture=microscope.aperture,
        wavelength_um=microscope.wavelength_um,
        index=microscope.medium_index,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DefocusModel:
    """One model of the defocus OTF."""

    curve: Callable[[Microscope, float], Curve]  # (microscope, z_um) -> x -> transfer
    diffracts: bool  # 0 beyond the cutoff


MODELS: Mapping[str, DefocusModel] = MappingProxyType(
    {
        "geometric": DefocusModel(
            curve=lambda m, z: lambda x: geometric(x, _paraxial_waves(m, z)),
            diffracts=False,
        ),
        "product": DefocusModel(
            curve=lambda m, z: lambda x: product(x, _paraxial_waves(m, z)),
            diffracts=True,
        ),
        "stokseth": DefocusModel(
            curve=lambda m, z: lambda x: stokseth(x, _rim_waves(m, z)),
            diffracts=True,
        ),
        "hopkins": DefocusModel(
            curve=lambda m, z: lambda x: hopkins(x, _rim_waves(m, z)),
            diffracts=True,
        ),
        "exact": DefocusModel(curve=_exact, diffracts=True),
    }
)


def curve_of(model: str, microscope: Microscope, z_um: float) -> Curve:
    """Return the transfer by a model; a lamp below the aperture has its own alone."""
    found = find_model(model)
    if microscope.cone_aperture == microscope.aperture:
        return found.curve(microscope, z_um)
    return lambda x: lamp_limited(
        x,
        z_um=z_um,
        aperture=microscope.aperture,
        lamp_aperture=microscope.cone_aperture,
        wavelength_um=microscope.wavelength_um,
        index=microscope.medium_index,
    )


def find_model(model: str) -> DefocusModel:
    """Return the model of a name; ValueError with the known names otherwise."""
    if model not in MODELS:
        raise ValueError(f"model must be one of {', '.join(MODELS)}, got {model!r}")
    return MODELS[model]


def transfer(
    model: str, microscope: Microscope, z_um: float, f_per_um: FloatArray
) -> FloatArray:
    """Return the transfer of `model` for a defocus, without table or interpolation.

    ValueError if the model is unknown or an argument holds a nan.

    Parameters
    ----------
    model : str
        A key of `MODELS`.
    z_um : float
        Height of the object minus that of the plane in focus.
    f_per_um : (...) float array
        Radial frequency in object space, cycles/um.

    Returns
    -------
    (...) float64 array
        1 at frequency 0. `product` and `geometric` take the paraxial W20, as the
        paper does, the others the rim-matched one.
    """
    return curve_of(model, microscope, z_um)(
        np.asarray(f_per_um, dtype=np.float64) / microscope.cutoff_per_um
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RadialTable:
    """A transfer function tabulated over sqrt(1 - x), where it is smooth.

    In x itself the end at x = 1 goes like (1 - x)**1.5 and spoils the interpolation.
    """

    first: float  # sqrt(1 - x) of the first node
    step: float
    pieces: FloatArray  # (4, N) cubic coefficients, the highest power first

    @classmethod
    def through(
        cls, first: float, step: float, values: FloatArray, slopes: FloatArray
    ) -> Self:
        """Return Hermite's cubics through values (N + 1,) [1] with slopes (N + 1,)."""
        rise = np.diff(values) / step
        before, after = slopes[:-1], slopes[1:]
        bend = (3 * rise - 2 * before - after) / step
        twist = (before + after - 2 * rise) / step**2
        pieces = np.stack([twist, bend, before, values[:-1]])
        pieces.setflags(write=False)
        return cls(first=first, step=step, pieces=pieces)

    def read(self, x: FloatArray) -> FloatArray:
        """Return the transfer [1] at `x` (...), held at the ends outside the table."""
        t = (np.sqrt(np.maximum(1 - x, 0)) - self.first) / self.step
        i = np.clip(t.astype(np.intp), 0, self.pieces.shape[1] - 1)
        t = np.clip(t - i, 0.0, 1.0) * self.step
        c3, c2, c1, c0 = (row[i] for row in self.pieces)
        value: FloatArray = ((c3 * t + c2) * t + c1) * t + c0
        return value


def tabulate(
    model: str, microscope: Microscope, z_um: float, x_max: float = 1.0
) -> RadialTable:
    """Return the table of `transfer` for x in 0..`x_max`.

    Its cubic interpolation errs by less than `TABLE_ERROR`; see `transfer` for the
    rest. It depends on no pixel, so images at all zooms share it.
    """
    if not 0 < x_max <= 1 or 1 - x_max == 1:
        raise ValueError(f"x_max must be in (1e-16, 1], got {x_max}")
    lens = replace(microscope.without_pixels, wavefront=())
    return _tabulate(model, lens, z_um, x_max)


@lru_cache(maxsize=256)  # layers of one height and draws of one focus share theirs
def _tabulate(
    model: str, microscope: Microscope, z_um: float, x_max: float
) -> RadialTable:
    first = math.sqrt(1 - x_max)
    # the phase of the marginal ray changes by 2 pi per cycle over the blur's radius,
    # and x by at most 2 per sqrt(1 - x)
    blur_um = microscope.blur_diameter_um(z_um)
    rate = 2 * math.pi * blur_um * microscope.cutoff_per_um
    steps = _LEAST + 2 * math.ceil(rate * (1 - first) / _STEP_RAD / 2)
    curve = curve_of(model, microscope, z_um)
    values, slopes = refined(lambda s: curve(1 - s**2), first, 1.0, steps + 1)
    return RadialTable.through(first, (1 - first) / steps, values, slopes)
