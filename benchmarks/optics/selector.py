"""Is the fidelity selector honest? Its predictions on random scenes, and the truth.

Optics, heights, shapes and limits are drawn at random. The truth of law and sampling is
the exact law, by the closed form where that is soon done, else with all of the band and
a margin of 640 wavelengths / A; layers are blended as they were. That of layers is the
same with every ray traced. Diffraction between layers, which a prediction for layers
bounds too, is in neither: `benchmarks.optics.layer_waves` measures it on straight
edges.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from microplan.arrays import FloatArray
from microplan.optics.layers.layer_error import choose_layers
from microplan.optics.layers.occlusion import occluded
from microplan.optics.layers.shading import render_coaxial
from microplan.optics.outline.outline import Outline, place
from microplan.optics.outline.warp import scaled
from microplan.optics.render.fidelity import Fidelity, choose
from microplan.optics.render.render import render
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.render.view_range import full
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.tradeoff.reference_images import (
    ReferenceView,
    exact_reference,
    traced_reference,
)
from tests.optics.shapes import circle, disc, gear, rectangle

COUNT = 500
LAYERED = 60  # of them, traced
SEED = 11
_FIELD = 40  # pixels a side
_MARGIN = 320.0  # half of the reference's, in wavelengths / A
_SHAPES = ("disc", "ring", "bar", "gear", "square")


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One random scene with the limit its image has to keep."""

    scene: Scene
    microscope: Microscope
    limit: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What was predicted for a scene, and what is true, of unit contrast."""

    predicted: float
    true: float
    unsure: float  # what the truth itself may err by

    @property
    def is_violated(self) -> bool:
        """Return whether an image errs by more than was predicted."""
        return self.true > self.predicted + self.unsure


def draw(index: int) -> Case:
    """Return scene number `index`: the same whatever else is drawn."""
    rng = np.random.default_rng(np.random.SeedSequence([SEED, index]))
    medium = float(rng.choice([1.0, 1.33, 1.5]))
    optics = Microscope(
        aperture=medium * rng.uniform(0.05, 0.95),
        wavelength_um=rng.uniform(0.4, 0.8),
        medium_index=medium,
        magnification=2 * 30 ** rng.uniform(),
        pitch_um=7.5,
        width_px=_FIELD,
        height_px=_FIELD,
        fill_factor=rng.uniform(0.3, 1.0),
    )
    count = int(rng.integers(1, 5))
    heights = np.cumsum(10 ** rng.uniform(0, 2, count))
    heights -= heights[int(rng.integers(count))]
    away = rng.choice([0.0, 10 ** rng.uniform(-1, math.log10(200))])
    layers = tuple(
        Layer(
            name=f"layer {k}",
            outline=_body(rng, optics),
            z_um=float(np.clip(heights[k] + away, -200 + k, 200 - count + k)),
            reflectance=rng.uniform(0, 1),
        )
        for k in range(count)
    )
    return Case(
        scene=Scene(layers=layers, background=rng.uniform(0, 1)),
        microscope=optics,
        limit=10 ** rng.uniform(-3.3, -1.3),
    )


def _body(rng: np.random.Generator, optics: Microscope) -> Outline:
    """Return a body of 2 to 200 um, its middle or an edge of it in the field."""
    size = 2 * 100 ** rng.uniform()
    body = _shape(rng, str(rng.choice(_SHAPES)), size)
    off = size / 2 * rng.choice([0.0, 1.0])
    turn, spread = rng.uniform(0, 2 * np.pi), optics.um_per_px * _FIELD / 3
    x, y = off * np.array([np.cos(turn), np.sin(turn)]) + rng.normal(0, spread / 3, 2)
    return place(body, float(x), float(y), rng.uniform(0, 2 * np.pi))


def _shape(rng: np.random.Generator, name: str, size: float) -> Outline:
    half = size / 2
    if name == "ring":
        return Outline(rings=(circle(half), circle(half * 0.6, hole=True)))
    if name == "bar":
        return rectangle(-half, -half / 5, half, half / 5)
    if name == "square":
        return rectangle(-half, -half, half, half)
    if name == "gear":
        return scaled(gear(int(rng.integers(6, 24))), size / 100, (0.0, 0.0))
    return disc(half)


def judge(index: int) -> Found:
    """Return what the selector says of law and sampling of a scene, and the truth."""
    case = draw(index)
    fidelity = choose(case.scene, case.microscope, focus_um=(0.0,), limit=case.limit)
    truth = exact_reference(_sight(case), _MARGIN)
    return Found(
        predicted=fidelity.predicted_error,
        true=float(np.abs(_blended(case, fidelity) - truth.images[0]).max()),
        unsure=truth.error,
    )


def judge_layers(index: int) -> Found | None:
    """Return what it says of all of a scene's image, None if no layers meet."""
    case = draw(index)
    fidelity = choose(case.scene, case.microscope, focus_um=(0.0,), limit=case.limit)
    layering = choose_layers(
        case.scene, case.microscope, focus_um=(0.0,), limit=case.limit
    )
    if layering.predicted_error == 0:
        return None
    sight = _sight(case)
    truth = traced_reference(sight, exact_reference(sight, _MARGIN), _MARGIN)
    image = _joint(case, fidelity)
    if layering.treatment == "occluded":
        image = occluded(
            case.scene, case.microscope, focus_um=0.0, model=fidelity.model
        )
    return Found(
        predicted=fidelity.predicted_error + layering.predicted_error,
        true=float(np.abs(image - truth.images[0]).max()),
        unsure=truth.error,
    )


def _blended(case: Case, fidelity: Fidelity) -> FloatArray:
    return render(
        case.scene,
        case.microscope,
        focus_um=0.0,
        model=fidelity.model,
        sampling=fidelity.sampling,
    )


def _joint(case: Case, fidelity: Fidelity) -> FloatArray:
    return render_coaxial(
        case.scene,
        case.microscope,
        focus_um=0.0,
        lamp_aperture=None,
        model=fidelity.model,
        sampling=fidelity.sampling,
    )


def _sight(case: Case) -> ReferenceView:
    return ReferenceView(
        scene=case.scene,
        microscope=case.microscope,
        window=full(case.microscope),
        focus_um=(0.0,),
    )


def _measure(options: Options) -> Iterator[Figure]:
    """Yield how often predictions fail, and by how much they exceed the truth."""
    with ProcessPoolExecutor(options.jobs) as pool:
        found = list(pool.map(judge, range(COUNT), chunksize=8))
        layered = [f for f in pool.map(judge_layers, range(LAYERED)) if f is not None]
    over = [f.predicted / f.true for f in found]
    beyond = [f.predicted / f.true for f in layered]
    for name, value in (
        ("violations", sum(f.is_violated for f in found)),
        ("median_overestimate", float(np.median(over))),
        ("largest_overestimate", max(over)),
        ("layers.violations", sum(f.is_violated for f in layered)),
        ("layers.median_overestimate", float(np.median(beyond))),
    ):
        yield Figure(name=f"selector.{name}", value=value, unit="1")


BENCHMARK = Benchmark(
    names=(
        "selector.violations",
        "selector.median_overestimate",
        "selector.largest_overestimate",
        "selector.layers.violations",
        "selector.layers.median_overestimate",
    ),
    measure=_measure,
)
