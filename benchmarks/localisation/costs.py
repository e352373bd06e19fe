"""Is the predicted work of a routine its work? Cost models against CPU time.

A routine's `cost` is in 640 x 480 box filters and depends on nothing measured; here it
is compared with CPU time over that of such a filter, each routine on the gear-on-shaft
job's looks at two zooms, started where it would be in a chain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.timing import cpu_s
from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import FRAME_PX, Failure, Guess
from microplan.featuresel.routines.registry import REGISTRY, load
from microplan.optics.render.scene import Window
from tests.featuresel.conftest import CASES, noisy, on_target

ZOOMS = (1.0, 2.0)
_REPEATS = 5
_SPAN_S = 0.02  # of one timing: the clock's grain is far below


@dataclass(frozen=True, slots=True, kw_only=True)
class Priced:
    """One routine on one look, in box filters."""

    routine: str
    look: str
    predicted: float
    measured: float

    @property
    def off(self) -> float:
        """Return by which factor the prediction is off, >= 1."""
        return max(self.predicted / self.measured, self.measured / self.predicted)


def box_s() -> float:
    """Return the CPU time of the unit: a box filter of 640 x 480 64-bit pixels."""
    image = np.random.default_rng(1).random((480, 640))
    assert image.size == FRAME_PX
    return min(_each_s(lambda: cv2.blur(image, (5, 5))) for _ in range(3 * _REPEATS))


def looks(zoom: float) -> Iterator[LookCase]:
    """Yield the job's looks with the magnification times `zoom`."""
    for case in (CASES[name]() for name in sorted(CASES)):
        rows, columns = (int(n * zoom) for n in (case.window.rows, case.window.columns))
        rows, columns = min(rows, 480), min(columns, 640)
        scope = case.microscope
        scope = replace(scope, magnification=scope.magnification * zoom)
        window = Window(
            row=(480 - rows) // 2, column=(640 - columns) // 2, rows=rows,
            columns=columns,
        )  # fmt: skip
        zoomed = replace(case, key=f"{case.key} x{zoom:g}", microscope=scope)
        target = replace(case.target, search_px=case.target.search_px * zoom)
        yield on_target(replace(zoomed, window=window, target=target))


def price(case: LookCase, unit_s: float) -> Iterator[Priced]:
    """Yield prediction and measurement of every routine that can look at `case`."""
    render = nominal_render(case)
    rng = np.random.default_rng(2)
    turn = 0.7 if case.theta_any else 0.05
    image = noisy(case, render(dx_um=2.0, dy_um=-1.5, theta_rad=turn), rng)
    k = case.target.px_per_um
    for name in sorted(REGISTRY):
        routine = load(name)
        if case.target.kind not in routine.kinds:
            continue
        artifact = routine.prepare(render, case.target)
        if isinstance(artifact, Failure):
            continue
        # where the routine before it in a chain would have ended
        near = "xy" in routine.requires
        theta = case.theta_rad + turn + 0.005
        guess = Guess(
            column=case.target.column + (2.0 * k + 0.3 if near else 0.0),
            row=case.target.row + (1.5 * k - 0.3 if near else 0.0),
            theta_rad=theta if near or not case.theta_any else None,
        )
        if isinstance(routine.measure(image, artifact, guess), Failure):
            continue

        def work(image: FloatArray = image, at: Guess = guess) -> None:
            routine.measure(image, artifact, at)  # noqa: B023 - called in this round

        measured = min(_each_s(work) for _ in range(_REPEATS))
        yield Priced(
            routine=name,
            look=case.key,
            predicted=routine.cost(artifact, image.size),
            measured=measured / unit_s,
        )


def _each_s(work: Callable[[], object]) -> float:
    """Return the CPU time of one call, the mean of as many as fill the span."""
    once = max(cpu_s(work), 1e-6)
    count = max(1, math.ceil(_SPAN_S / once))

    def many() -> None:
        for _ in range(count):
            work()

    return cpu_s(many) / count


def measure(_options: Options) -> Iterator[Figure]:
    """Yield how far predictions are off: the median factor and the worst."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        unit_s = box_s()
        found = [p for z in ZOOMS for case in looks(z) for p in price(case, unit_s)]
    finally:
        cv2.setNumThreads(threads)
    off = [priced.off for priced in found]
    yield Figure(name="costs.median_factor", value=float(np.median(off)), unit="1")
    yield Figure(name="costs.worst_factor", value=max(off), unit="1")


BENCHMARK = Benchmark(
    names=("costs.median_factor", "costs.worst_factor"), measure=measure
)


def main() -> None:
    """Print every routine on every look."""
    cv2.setNumThreads(1)
    unit_s = box_s()
    print(f"box filter {unit_s * 1e3:.3f} ms")
    for zoom in ZOOMS:
        for case in looks(zoom):
            for found in price(case, unit_s):
                print(
                    f"{found.routine:18} {found.look:14} predicted "
                    f"{found.predicted:7.2f} measured {found.measured:7.2f}"
                )


if __name__ == "__main__":
    main()
