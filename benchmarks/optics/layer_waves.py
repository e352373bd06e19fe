"""How far blending and traced rays are from a wave calculation, for edges and bars.

The constants of `microplan.optics.layers.layer_error` are the largest values found
here, rounded up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from benchmarks.figures import Figure
from microplan.arrays import FloatArray
from microplan.optics.layers.layer_error import layer_error
from microplan.optics.layers.occlusion import occluded
from microplan.optics.layers.shading import render_coaxial
from microplan.optics.outline.outline import Outline
from microplan.optics.render.render import render
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.otf import diffraction, hopkins
from tests.optics.shapes import microscope, rectangle
from tests.optics.wave import behind_a_mask, places, points

Bars = tuple[tuple[float, float], ...]

STEP = 0.0875  # of the wave grid, wavelength / A
COUNT = 1536
# Heights n wavelength / A**2 above focus, all pairs of them.
HEIGHTS = (-16, -8, -4, -2, -1, -0.5, -0.25, 0, 0.25, 0.5, 1, 2, 4, 8, 16)
RAYS = 192
KINDS = ("edges", "bars")
TREATMENTS = ("blend", "joint", "occluded")
CASES = 30  # random ones of each kind
_SEEN = 0.02  # truths below it say nothing of how tight a prediction is

NAMES = (
    *(f"layers.waves.{name}" for name in ("near_focus", "fall", "close")),
    *(
        f"layers.waves.{kind}.{treatment}_{figure}"
        for kind in KINDS
        for treatment in TREATMENTS
        for figure in ("least", "median")
    ),
)


def measure() -> Iterator[Figure]:
    """Compare a table of straight edges, then random scenes, with waves."""
    yield from _table()
    rng = np.random.default_rng(1)
    for kind in KINDS:
        cases = [random_case(rng, kind) for _ in range(CASES)]
        found = np.array([compare(case) for case in cases])  # (cases, 3, 2)
        for i, treatment in enumerate(TREATMENTS):
            truth, predicted = found[:, i].T
            ratio = predicted / truth
            value = (float(ratio.min()), float(np.median(ratio[truth > _SEEN])))
            for figure, number in zip(("least", "median"), value, strict=True):
                name = f"layers.waves.{kind}.{treatment}_{figure}"
                yield Figure(name=name, value=number, unit="predicted / true")


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Bright bars behind black ones; places in wavelength / A."""

    back_z: float  # n wavelength / A**2 above focus
    front_z: float
    back: Bars
    front: Bars

    def scene(self, optics: Microscope) -> Scene:
        """Return the bars as long rectangles."""
        depth = optics.wavelength_um / optics.aperture**2
        layers = [
            Layer(
                name=name,
                outline=_outline(bars, optics.wavelength_um / optics.aperture),
                z_um=z * depth,
                reflectance=tone,
            )
            for name, bars, z, tone in (
                ("back", self.back, self.back_z, 1.0),
                ("front", self.front, self.front_z, 0.0),
            )
        ]
        return Scene(layers=tuple(layers), background=0.0)

    def truth(self, x: FloatArray) -> FloatArray:
        """Return the image by waves at places (N,)."""
        back, front = _covered(x, self.back), _covered(x, self.front)
        return behind_a_mask(x, back, 1 - front, self.front_z, self.back_z)


def line(cells: int) -> Microscope:
    """Return a microscope whose pixels in a row are cells of the wave grid.

    Its aperture is small, so that tangents are sines and the paraxial law is exact.
    """
    optics = replace(microscope(1.0, cells, 1), aperture=0.15, fill_factor=1e-6)
    airy = optics.wavelength_um / optics.aperture
    return replace(optics, magnification=optics.pitch_um / (STEP * airy))


def random_case(rng: np.random.Generator, kind: str) -> Case:
    """Return two straight edges, or one to two bars in front of one to two others."""
    near = rng.random(2) < 0.15
    heights = rng.choice([-1, 1], 2) * 10 ** rng.uniform(-1, 1, 2) * ~near
    low, high = np.sort(heights + [0, 1e-3])
    if kind == "edges":
        reach = min(1.3 * (abs(low) + abs(high)) + 1, 14.0)
        edge = _snapped(rng.uniform(-reach, reach))
        plates: tuple[Bars, Bars] = ((_snapped(-30), edge),), ((0.0, _snapped(42)),)
    else:
        plates = _random_bars(rng), _random_bars(rng)
    back, front = plates
    return Case(back_z=float(low), front_z=float(high), back=back, front=front)


def compare(case: Case) -> tuple[tuple[float, float], ...]:
    """Return the true and the predicted error of each treatment."""
    x = places(COUNT, STEP)
    near = np.abs(x) < 16
    optics = line(int(near.sum()))
    scene, truth = case.scene(optics), case.truth(x)[near]
    images = (
        render(scene, optics, focus_um=0.0, model="hopkins"),
        render_coaxial(
            scene, optics, focus_um=0.0, lamp_aperture=None, model="hopkins"
        ),
        occluded(scene, optics, focus_um=0.0, model="hopkins"),
    )
    return tuple(
        (
            float(np.abs(image[0] - truth).max()),
            layer_error(scene, optics, focus_um=0.0, treatment=treatment),
        )
        for image, treatment in zip(images, TREATMENTS, strict=True)
    )


def _table() -> Iterator[Figure]:
    """Find what rays lack for straight edges at any distance, by pairs of heights."""
    most = fall = close = 0.0
    for i, front_z in enumerate(HEIGHTS):
        for back_z in HEIGHTS[:i]:
            lacks = ray_error(front_z, back_z)
            nearer = min(abs(front_z), abs(back_z))
            most = max(most, lacks)
            fall = max(fall, lacks * math.sqrt(nearer)) if nearer >= 2 else fall
            near = front_z - back_z <= 0.25
            close = max(close, lacks / math.sqrt(front_z - back_z)) if near else close
    values = (most, fall, close)
    for name, value in zip(NAMES[:3], values, strict=True):
        yield Figure(name=name, value=value, unit="unit contrast")


def ray_error(front_z: float, back_z: float) -> float:
    """Return the largest error of traced rays, over all distances of two edges.

    In one dimension, where slopes follow the half circle that a pupil's strips do.
    """
    x = places(COUNT, STEP)
    span = min(2 * (front_z - back_z) + abs(front_z) + abs(back_z) + 3, 20.0)
    edges = np.unique(np.round(np.linspace(-span, span, 41) / STEP)) * STEP
    mask = (x < 0).astype(np.float64)
    # images of half planes from far left to each edge, all at once
    sums = np.cumsum(points(x, np.arange(COUNT), mask, front_z, back_z), axis=0)
    truth = sums[np.searchsorted(x, edges) - 1] - sums[np.searchsorted(x, -50.0)]
    found = _traced(x, edges, front_z, back_z)
    return float(np.abs(found - truth)[:, np.abs(x) < 22].max())


def _traced(
    x: FloatArray, edges: FloatArray, front_z: float, back_z: float
) -> FloatArray:
    """Return what `occluded` does, (edges, N)."""
    grid = np.linspace(-1, 1, 20_001)
    share = 0.5 + (grid * np.sqrt(1 - grid**2) + np.arcsin(grid)) / np.pi
    slopes = np.interp((np.arange(RAYS) + 0.5) / RAYS, share, grid)
    mean = np.zeros((3, len(edges), x.size))
    for slope in slopes:
        behind = _left_of(edges[:, None], x + back_z * slope)
        before = _left_of(np.zeros((1, 1)), x + front_z * slope)
        mean[0] += behind * before / RAYS
        mean[1] += behind / RAYS
        mean[2] += before / RAYS
    both, *alone = (_filtered(each, diffraction) for each in mean)
    back, front = _left_of(edges[:, None], x), _left_of(np.zeros((1, 1)), x)
    blend = _filtered(back, lambda s: hopkins(s, back_z / 2)) * _filtered(
        front, lambda s: hopkins(s, front_z / 2)
    )
    return np.asarray(blend + both - alone[0] * alone[1])


def _left_of(edge: FloatArray, x: FloatArray) -> FloatArray:
    """Return the share of cells at `x` left of an edge."""
    share: FloatArray = np.clip((edge - x) / STEP + 0.5, 0, 1)
    return share


def _filtered(
    values: FloatArray, law: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Filter rows that are continued by their mirror images."""
    s = np.arange(values.shape[1]) / (4 * values.shape[1] * STEP)
    gain = np.where(s < 1, law(np.minimum(s, 1.0)), 0.0)
    found: FloatArray = fft.idct(fft.dct(values, axis=1) * gain, axis=1)
    return found


def _snapped(value: float) -> float:
    """Return the nearest border of two cells."""
    return round(value / STEP) * STEP


def _random_bars(rng: np.random.Generator) -> Bars:
    center, (a, b, c) = rng.uniform(-4, 4), 10 ** rng.uniform(-0.3, 0.8, 3)
    bars = [(center - a, center + a)]
    if rng.random() < 0.5:
        bars = [(center - a - b, center - b), (center, center + c)]
    return tuple((_snapped(low), _snapped(high)) for low, high in bars)


def _covered(x: FloatArray, bars: Bars) -> FloatArray:
    inside = np.zeros(x.size)
    for low, high in bars:
        inside[(x > low) & (x < high)] = 1
    return inside


def _outline(bars: Bars, airy: float) -> Outline:
    rings = [
        rectangle(low * airy, -150 * airy, high * airy, 150 * airy).rings[0]
        for low, high in bars
    ]
    return Outline(rings=tuple(rings))
