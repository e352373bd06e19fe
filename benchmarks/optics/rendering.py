"""Rendering the gear through focus: time against floor and rivals, error, memory.

Times are CPU times of one thread, so that a busy machine spoils no ratio.
"""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from scipy import fft

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.optics.raster import coverage
from benchmarks.rivals import peers
from benchmarks.rivals.naive import Naive
from benchmarks.timing import cpu_s
from microplan.arrays import FloatArray
from microplan.optics.oracle import Oracle
from microplan.optics.outline.outline import Outline
from microplan.optics.render.render import render, render_stack
from microplan.optics.transfer.microscope import Microscope
from tests.optics.shapes import gear, microscope, one_layer, polygon

PLANES_UM = np.linspace(-50, 50, 41)  # pairs at one distance share their blur
ONE_SIDED_UM = np.linspace(0, 50, 41)
CHECKED_UM = (0.0, 2.5, 10.0, 25.0, 50.0)  # planes compared with the oracle
RIVAL_UM = (0.0, 25.0, 50.0)  # a rival's time may grow with defocus, hence its mean
MAGNIFICATIONS = (6.9, 44.5)
SIZES = (1024, 2048)
VERTICES = (1_000, 10_000, 100_000)
KINDS = (
    "ms_per_image",
    "one_sided_ms",
    "cold_ms",
    "max_error",
    "rms_error",
    "peak_mib",
)
RIVALS = ("naive", *peers.available())
RIVAL_KINDS = ("ms_per_image", "setup_ms", "max_error", "rms_error", "peak_mib")


def floor_ms(rows: int = 480, columns: int = 640) -> float:
    """Return the time of one float64 real transform pair of a frame, ms."""
    image = np.random.default_rng(1).random((rows, columns))

    def pairs() -> None:
        for _ in range(10):
            fft.irfft2(fft.rfft2(image), s=image.shape)

    return _best_ms(pairs, 5) / 10


def _measure(_options: Options) -> Iterator[Figure]:
    if not peers.available():
        print(f"no peers to compare with, see {peers.__name__}", file=sys.stderr)
    for magnification in MAGNIFICATIONS:
        optics = microscope(magnification, 640, 480)
        yield from _figures(optics, f"rendering.m{magnification:g}")
    for size in SIZES:
        yield from _large(size)
    yield from _many_vertices()


BENCHMARK = Benchmark(
    names=(
        *(
            f"rendering.m{m:g}.{kind}"
            for m in MAGNIFICATIONS
            for kind in (
                *KINDS,
                *(f"{rival}.{kind}" for rival in RIVALS for kind in RIVAL_KINDS),
            )
        ),
        *(
            f"rendering.size{n}.{kind}"
            for n in SIZES
            for kind in ("ms_per_image", "peak_mib")
        ),
        *(
            f"rendering.{kind}{n}.ms"
            for n in VERTICES
            for kind in ("vertices", "raster")
        ),
    ),
    measure=_measure,
)


def _figures(optics: Microscope, name: str) -> Iterator[Figure]:
    """Measure one magnification; the first stack of the process counts as cold."""
    stack = _stack(optics, tuple(PLANES_UM))
    cold_ms = 1000 * cpu_s(stack) / PLANES_UM.size
    # floor and stack by turns, the best of each: both meet the machine's quiet moments
    sided = _stack(optics, tuple(ONE_SIDED_UM))
    sided()
    turns = [(_best_ms(stack, 2), floor_ms(), _best_ms(sided, 2)) for _ in range(3)]
    warm_ms, least_ms, sided_ms = (min(times) for times in zip(*turns, strict=True))
    oracle = Oracle.of(gear(), optics)
    exact = oracle.images([("exact", z) for z in CHECKED_UM])
    truth = exact[[CHECKED_UM.index(z) for z in RIVAL_UM]]
    rivals = {rival: _rival(rival, optics, truth) for rival in RIVALS}
    yield Figure(
        name=f"{name}.ms_per_image",
        value=warm_ms / PLANES_UM.size,
        unit="ms",
        floor=least_ms,
        rival=min(found["ms_per_image"] for found in rivals.values()),
    )
    yield Figure(
        name=f"{name}.one_sided_ms",
        value=sided_ms / ONE_SIDED_UM.size,
        unit="ms",
        floor=least_ms,
        rival=min(found["ms_per_image"] for found in rivals.values()),
    )
    yield Figure(name=f"{name}.cold_ms", value=cold_ms, unit="ms")
    # two planes at the ends keep the tile of the whole stack
    found = _stack(optics, (*CHECKED_UM, -50.0))()[:-1]
    yield from _errors(f"{name}.", found, exact)
    peak_mib = _peak_mib(_stack(optics, tuple(PLANES_UM)))
    yield Figure(name=f"{name}.peak_mib", value=peak_mib, unit="MiB")
    units = dict(zip(RIVAL_KINDS, ("ms", "ms", *["unit contrast"] * 2, "MiB"),
                     strict=True))  # fmt: skip
    for rival, figures in rivals.items():
        for kind in RIVAL_KINDS:
            yield Figure(
                name=f"{name}.{rival}.{kind}", value=figures[kind], unit=units[kind]
            )


def _stack(optics: Microscope, z_um: Sequence[float]) -> Callable[[], FloatArray]:
    """Return a renderer of the gear at heights above the plane in focus."""
    focus = tuple(-z for z in z_um)
    return partial(render_stack, one_layer(gear()), optics, focus_um=focus)


def _rival(rival: str, optics: Microscope, truth: FloatArray) -> dict[str, float]:
    """Return the figures of one rival."""
    if rival == "naive":
        naive = Naive(outline=gear(), microscope=optics)
        first_ms = 1000 * cpu_s(partial(naive.image, 0.0))
        times = [1000 * cpu_s(partial(naive.image, z)) for z in RIVAL_UM]
        images = np.stack([naive.image(z) for z in RIVAL_UM])
        peak = _peak_mib(partial(naive.image, RIVAL_UM[-1]))
        mean_ms = float(np.mean(times))
        figures = {"ms_per_image": mean_ms, "setup_ms": first_ms, "peak_mib": peak}
    else:
        result = peers.run(rival, gear(), optics, RIVAL_UM)
        images = result.images
        figures = {
            "ms_per_image": 1000 * result.seconds,
            "setup_ms": 1000 * result.setup_s,
            "peak_mib": result.peak_mib,
        }
    return figures | {f.name: f.value for f in _errors("", images, truth)}


def _errors(name: str, found: FloatArray, exact: FloatArray) -> Iterator[Figure]:
    """Compare with the exact phase, summed exactly."""
    error = np.abs(found - exact)
    rms = float(np.sqrt(np.mean(error**2)))
    for kind, value in (("max_error", float(error.max())), ("rms_error", rms)):
        yield Figure(name=f"{name}{kind}", value=value, unit="unit contrast")


def _large(size: int) -> Iterator[Figure]:
    """Measure a larger frame; the part is seen whole."""
    optics, planes = microscope(44.5, size, size), tuple(ONE_SIDED_UM[::5])
    stack = _stack(optics, planes)
    stack()
    yield Figure(
        name=f"rendering.size{size}.ms_per_image",
        value=_best_ms(stack, 3) / len(planes),
        unit="ms",
        floor=floor_ms(size, size),
    )
    peak_mib = _peak_mib(_stack(optics, planes))
    yield Figure(name=f"rendering.size{size}.peak_mib", value=peak_mib, unit="MiB")


def _many_vertices() -> Iterator[Figure]:
    """Measure one image of wheels with more and more teeth, another each time."""
    optics = microscope(6.9, 640, 480)
    for count in VERTICES:
        wheels = [_wheel(count, k * 0.01) for k in range(3)]
        rendered, covered = (
            1000 * min(cpu_s(partial(work, wheel)) for wheel in wheels)
            for work in (
                lambda wheel: render(one_layer(wheel), optics, focus_um=0.0),
                lambda wheel: coverage(wheel, optics),
            )
        )
        yield Figure(
            name=f"rendering.vertices{count}.ms",
            value=rendered,
            unit="ms",
            floor=floor_ms(),
        )
        yield Figure(name=f"rendering.raster{count}.ms", value=covered, unit="ms")


def _wheel(count: int, left_um: float) -> Outline:
    """Return a polygon of `count` corners on two radii, `left_um` off the centre."""
    angle = np.arange(count) * 2 * np.pi / count
    radius = np.where(np.arange(count) % 2, 50.0, 49.5)
    x, y = radius * np.cos(angle) - left_um, radius * np.sin(angle)
    return polygon(list(zip(x.tolist(), y.tolist(), strict=True)))


def _best_ms(work: Callable[[], object], repeats: int) -> float:
    return 1000 * min(cpu_s(work) for _ in range(repeats))


def _peak_mib(work: Callable[[], object]) -> float:
    """Return the most memory that a call holds at once, its result included, MiB."""
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 2**20
