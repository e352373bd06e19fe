"""Images of random outlines: what defocus laws err by, against the bound for any.

Settings, defocus and shapes are drawn at random: discs, rings, bars, gratings, gears,
stars and zone plates. Both images have the same tile and all of the band, and what a
tile repeats is an outline as well, so that the laws and their tables alone differ.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.defocus.law_bounds import LAWS
from benchmarks.defocus.model_error import model_error_bound
from benchmarks.figures import Benchmark, Figure, Options
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.render import render
from microplan.optics.render.sampling import Sampling
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import TABLE_ERROR
from tests.optics.shapes import circle, disc, gear, one_layer, polygon, rectangle

Draw = Callable[[np.random.Generator, float], Outline]

COUNT = 500
_FIELD = 48  # pixels a side
_WHOLE = Sampling(band_error=1e-12, margin=20.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One law on one outline."""

    law: str
    shape: str
    error: float  # against the exact phase, of unit contrast
    predicted: float


def trials(count: int, seed: int = 5) -> Iterator[Trial]:
    """Compare all laws on `count` outlines."""
    rng = np.random.default_rng(seed)
    names = tuple(SHAPES)
    for _ in range(count):
        shape = names[int(rng.integers(len(names)))]
        optics, z_um = _setting(rng)
        # from finer than the blur to wider
        blur = optics.blur_diameter_um(z_um) + optics.airy_radius_um
        outline = SHAPES[shape](rng, blur * 10 ** rng.uniform(-0.7, 0.5))
        yield from _judged(shape, outline, optics, z_um)


def _setting(rng: np.random.Generator) -> tuple[Microscope, float]:
    """Draw optics and a defocus of .01 to 30 waves; a field is 3 blurs wide or more."""
    index = float(rng.choice([1.0, 1.33, 1.5]))
    optics = Microscope(
        aperture=index * rng.uniform(0.05, 0.95),
        wavelength_um=rng.uniform(0.4, 0.8),
        medium_index=index,
        magnification=1.0,
        pitch_um=1.0,
        width_px=_FIELD,
        height_px=_FIELD,
        fill_factor=rng.uniform(0.3, 1.0),
    )
    z_um = 10 ** rng.uniform(-2, 1.5) * optics.wavelength_um / optics.rim_w20_um(1.0)
    wide = 3 * (optics.blur_diameter_um(z_um) + optics.airy_radius_um)
    pitch_um = wide / _FIELD * 10 ** rng.uniform(0, 0.6)
    return replace(optics, pitch_um=pitch_um), z_um


def _judged(
    shape: str, outline: Outline, optics: Microscope, z_um: float
) -> Iterator[Trial]:
    """Render one outline by every law and by the exact phase."""
    scene = one_layer(outline, z_um)
    exact = render(scene, optics, focus_um=0.0, sampling=_WHOLE)
    for law in LAWS:
        image = render(scene, optics, focus_um=0.0, model=law, sampling=_WHOLE)
        error = float(np.abs(image - exact).max())
        predicted = model_error_bound(law, optics, z_um)
        yield Trial(law=law, shape=shape, error=error, predicted=predicted)


def _ring(_rng: np.random.Generator, size: float) -> Outline:
    return Outline(rings=(circle(size), circle(0.6 * size, hole=True)))


def _bar(rng: np.random.Generator, size: float) -> Outline:
    bar = rectangle(-20 * size, -size / 2, 20 * size, size / 2)
    return place(bar, 0.0, 0.0, rng.uniform(0, math.pi))


def _grating(rng: np.random.Generator, size: float) -> Outline:
    bars = [
        rectangle(k * size, -9 * size, (k + 0.5) * size, 9 * size) for k in range(-8, 8)
    ]
    rings = tuple(ring for bar in bars for ring in bar.rings)
    return place(Outline(rings=rings), 0.0, 0.0, rng.uniform(0, math.pi))


def _gear(rng: np.random.Generator, size: float) -> Outline:
    """Return a gear whose rim or middle lies on the axis; 50 um times 1."""
    teeth = int(rng.integers(3, 30))
    at = float(rng.choice([0.0, -47.0]))
    return place(gear(teeth), at, rng.uniform(-2, 2) * size)


def _star(rng: np.random.Generator, size: float) -> Outline:
    """Return a polygon of random corners around the middle."""
    turns = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(5, 40))))
    radii = size * 10 ** rng.uniform(-0.7, 0.3, turns.size)
    corners = zip(radii * np.cos(turns), radii * np.sin(turns), strict=True)
    return polygon([(float(x), float(y)) for x, y in corners])


def _zones(rng: np.random.Generator, size: float) -> Outline:
    """Return zones of equal area, which gather errors in their middle."""
    first = size * rng.uniform(0.3, 1)
    radii = [first * math.sqrt(k) for k in range(2 * int(rng.integers(2, 9)), 0, -1)]
    rings = [circle(r, hole=bool(k % 2)) for k, r in enumerate(radii)]
    return Outline(rings=tuple(rings))


SHAPES: dict[str, Draw] = {
    "disc": lambda _rng, size: disc(size),
    "ring": _ring,
    "bar": _bar,
    "grating": _grating,
    "gear": _gear,
    "star": _star,
    "zones": _zones,
}


def _measure(_options: Options) -> Iterator[Figure]:
    found = list(trials(COUNT))
    # the prediction holds the error of one table, the exact image has another
    beyond = sum(t.error > t.predicted + TABLE_ERROR for t in found)
    shares = np.array([(t.error - TABLE_ERROR) / t.predicted for t in found])
    yield Figure(name="law_outlines.beyond_bound", value=beyond, unit="1")
    yield Figure(name="law_outlines.worst_share", value=float(shares.max()), unit="1")
    for law in LAWS:
        over = [t.predicted / t.error for t in found if t.law == law and t.error > 1e-4]
        median = float(np.median(over))
        yield Figure(
            name=f"law_outlines.{law}.median_overestimate", value=median, unit="1"
        )


BENCHMARK = Benchmark(
    names=(
        "law_outlines.beyond_bound",
        "law_outlines.worst_share",
        *(f"law_outlines.{law}.median_overestimate" for law in LAWS),
    ),
    measure=_measure,
)


if __name__ == "__main__":
    for each in trials(int(sys.argv[1])):
        print(each)
