"""Rendering the gear through focus: time against a floor and a rival, and error."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy import fft

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.naive import Naive
from benchmarks.timing import best_s, once_s
from optics.microscope import Microscope
from optics.oracle import Oracle
from optics.render import render_stack
from tests.optics.shapes import gear, microscope, one_layer

FloatArray = npt.NDArray[np.float64]

PLANES_UM = np.linspace(-50, 50, 41)
CHECKED_UM = (0.0, 2.5, 10.0, 25.0, 50.0)  # planes compared with the oracle
RIVAL_UM = (0.0, 25.0, 50.0)  # the rival's time grows with defocus, hence its mean
MAGNIFICATIONS = (6.9, 44.5)
KINDS = ("ms_per_image", "cold_ms", "max_error", "rival_max_error")


def floor_ms() -> float:
    """Return the time of one float64 640 x 480 real transform pair, ms."""
    image = np.random.default_rng(1).random((480, 640))

    def pair() -> FloatArray:
        back: FloatArray = fft.irfft2(fft.rfft2(image), s=image.shape)
        return back

    return 1000 * best_s(pair, 20)


def _measure(_options: Options) -> Iterator[Figure]:
    for magnification in MAGNIFICATIONS:
        optics = microscope(magnification, 640, 480)
        yield from _figures(optics, f"rendering.m{magnification:g}")


BENCHMARK = Benchmark(
    names=tuple(f"rendering.m{m:g}.{kind}" for m in MAGNIFICATIONS for kind in KINDS),
    measure=_measure,
)


def _figures(optics: Microscope, name: str) -> Iterator[Figure]:
    """Measure one magnification; the first stack of the process counts as cold."""
    scene, naive = one_layer(gear()), Naive(outline=gear(), microscope=optics)

    def stack() -> FloatArray:
        # an object z above the plane in focus: focus at -z
        return render_stack(scene, optics, focus_um=tuple(-PLANES_UM))

    cold_s = once_s(stack)
    warm_s = best_s(stack, 3)
    rival_s = float(np.mean([once_s(partial(naive.image, z)) for z in RIVAL_UM]))
    floor = floor_ms()
    yield Figure(
        name=f"{name}.ms_per_image",
        value=1000 * warm_s / PLANES_UM.size,
        unit="ms",
        floor=floor,
        rival=1000 * rival_s,
    )
    yield Figure(
        name=f"{name}.cold_ms", value=1000 * cold_s / PLANES_UM.size, unit="ms"
    )
    yield from _errors(optics, naive, name)


def _errors(optics: Microscope, naive: Naive, name: str) -> Iterator[Figure]:
    """Compare with the exact phase, summed exactly."""
    oracle = Oracle.of(gear(), optics)
    focus = tuple(-z for z in CHECKED_UM)
    ours = render_stack(one_layer(gear()), optics, focus_um=focus)
    exact = list(oracle.images([("exact", z) for z in CHECKED_UM]))
    rival = [naive.image(z) for z in RIVAL_UM]
    truth = [exact[CHECKED_UM.index(z)] for z in RIVAL_UM]
    for kind, found, expected in (
        ("max_error", list(ours), exact),
        ("rival_max_error", rival, truth),
    ):
        pairs = zip(found, expected, strict=True)
        worst = max(float(np.abs(a - b).max()) for a, b in pairs)
        yield Figure(name=f"{name}.{kind}", value=worst, unit="unit contrast")
