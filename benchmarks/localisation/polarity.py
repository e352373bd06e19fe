"""Predicted polarity of the edges of random parts against the exact reference.

Parts are drawn at random: polygons and half discs with holes, thin slots side by side,
toothed discs; so are reflectances, backgrounds, focus, zoom, a neighbour above or
below. The prediction comes from what routines are prepared with, another defocus law,
fast and integrated over pixels; the truth from the oracle's exact law at points, layer
by layer, with what two of them hide together by rays (`hidden_together`). In light from
below and from a ring the truth is traced ray by ray (`lit_parts`).
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.selection.hidden_together import hidden_together
from benchmarks.selection.lit_parts import KINDS, judged
from benchmarks.selection.random_parts import random_case
from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contour.polarity import place, predict
from microplan.featuresel.routines.sampling import cubic
from microplan.optics.oracle import Oracle
from microplan.optics.outline.outline import place as placed
from microplan.optics.render.scene import Window
from microplan.optics.transfer.microscope import Microscope

PARTS, LIT_PARTS = 200, 40
_SEED = 7
_OVER = 4  # truth's samples per pixel: .27 um at m = 6.9, below the band's .36
_POINT = 1e-12  # fill factor: no area
_WRAP = 4e-3  # error of the reference allowed: .2 of the faintest step, and spread out
_ASIDE = 1.0  # of the blur in focus: where an edge's sides are compared


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """One part: its points, how many were kept, and how many of those are wrong."""

    points: int
    kept: int
    wrong: int


def judge(seed: int) -> Judged:
    """Return how the prediction for one random part compares with the truth.

    In light from the front, which nothing shades.
    """
    case = random_case(np.random.default_rng((_SEED, seed)))
    found = predict(nominal_render(case), case.target)
    contour = np.array(case.target.contour)
    brighter = outside_less_inside(case, contour)
    wrong = found.kept & (brighter * found.step <= 0)
    return Judged(
        points=len(contour), kept=int(found.kept.sum()), wrong=int(wrong.sum())
    )


def judge_lit(kind: str, seed: int) -> Judged:
    """Return the same in light of one of `KINDS`."""
    points, kept, wrong = judged(kind, (_SEED, seed))
    return Judged(points=points, kept=kept, wrong=wrong)


def outside_less_inside(case: LookCase, contour: FloatArray) -> FloatArray:
    """Return (N,) how much brighter the exact image is outside of edges than inside."""
    scope = replace(
        case.microscope,
        pitch_um=case.microscope.pitch_um / _OVER,
        width_px=case.microscope.width_px * _OVER,
        height_px=case.microscope.height_px * _OVER,
        fill_factor=_POINT,
    )
    where = place(contour, case.target)
    # pixels of the coarse frame to samples of the fine one
    w = case.window
    window = Window(
        row=w.row * _OVER,
        column=w.column * _OVER,
        rows=w.rows * _OVER,
        columns=w.columns * _OVER,
    )
    image = _exact(case, scope, window)
    aside_px = _ASIDE * scope.airy_radius_um * scope.px_per_um
    ends = [
        cubic(
            image,
            (where[:, 0] + 0.5) * _OVER - 0.5 + side * aside_px * where[:, 2],
            (where[:, 1] + 0.5) * _OVER - 0.5 + side * aside_px * where[:, 3],
        )[0]
        for side in (1, -1)
    ]
    return ends[0] - ends[1]


def _exact(case: LookCase, scope: Microscope, window: Window) -> FloatArray:
    """Return the layers by the exact law, laid over each other from below.

    What two of them hide together is mended by rays.
    """
    image = np.full((window.rows, window.columns), case.background)
    moved = [
        replace(
            layer, outline=placed(layer.outline, case.x_um, case.y_um, case.theta_rad)
        )
        for layer in case.moving
    ]
    layers = sorted((*case.static, *moved), key=lambda one: one.z_um)
    for layer in layers:
        z_um = layer.z_um - case.focus_um
        oracle = Oracle.of(
            layer.outline,
            scope,
            window=window,
            deepest_um=abs(z_um) + 1,
            wrap_error=_WRAP,
        )
        coverage = oracle.image("exact", z_um)
        image = (1 - coverage) * image + layer.reflectance * coverage
    if len(layers) > 1:
        image += hidden_together(case, layers, scope, window)
    return image


def _measure(options: Options) -> Iterator[Figure]:
    """Judge all parts in all kinds of light."""
    found: dict[str, list[Judged]] = {}
    with ProcessPoolExecutor(options.jobs) as pool:
        found["front"] = list(pool.map(judge, range(PARTS), chunksize=4))
        for kind in KINDS:
            lit = partial(judge_lit, kind)
            found[kind] = list(pool.map(lit, range(LIT_PARTS), chunksize=2))
    everything = [one for kind in found.values() for one in kind]
    points = sum(one.points for one in found["front"])
    kept = sum(one.kept for one in found["front"])
    wrong = sum(one.wrong for one in everything)
    yield Figure(name="polarity.wrong", value=wrong, unit="1")
    yield Figure(name="polarity.kept_share", value=kept / points, unit="1")
    for kind in KINDS:
        wrong = sum(one.wrong for one in found[kind])
        yield Figure(name=f"polarity.{kind}.wrong", value=wrong, unit="1")


BENCHMARK = Benchmark(
    names=(
        "polarity.wrong",
        "polarity.kept_share",
        *(f"polarity.{kind}.wrong" for kind in KINDS),
    ),
    measure=_measure,
)
