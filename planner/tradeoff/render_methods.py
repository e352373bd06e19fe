"""Methods of rendering one look: their times, their errors by the oracle."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from microplan.arrays import FloatArray
from microplan.optics.layers.occlusion import SAMPLES, occluded
from microplan.optics.outline.outline import place
from microplan.optics.render.fidelity import Fidelity
from microplan.optics.render.render import render
from microplan.optics.render.sampling import BAND_ERROR, MARGIN, Sampling
from microplan.optics.render.scene import Window
from microplan.optics.transfer.models import MODELS
from microplan.planner.tradeoff.reference_images import ReferenceImages, ReferenceView
from microplan.planner.tradeoff.tradeoff_record import MeasuredMethod
from microplan.schemas.codec import quantise

BANDS = (5e-3, 5e-4, 5e-5)  # from invisible errors to those of tables
MARGINS = (10.0, 40.0)
RAYS = (SAMPLES // 4, SAMPLES)  # a cell, of occluded layers
REPEATS = 3  # of which the least time counts; 2 where they take long
_ENOUGH_S = 0.1
# Between the poses of timed images, um: far below what an image shows, and enough that
# nothing kept of one image serves another.
_STEP_UM = 1e-4
_USUAL = Sampling(band_error=BAND_ERROR, margin=MARGIN)


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderMethod:
    """One method of computing an image."""

    model: str
    sampling: Sampling
    rays: int = 0  # 0: layers are blended

    def image(self, seen: ReferenceView, focus_um: float) -> FloatArray:
        """Return the image, (rows, columns)."""
        if self.rays:
            return occluded(
                seen.scene,
                seen.microscope,
                focus_um=focus_um,
                model=self.model,
                window=seen.window,
                samples=self.rays,
            )
        return render(
            seen.scene,
            seen.microscope,
            focus_um=focus_um,
            model=self.model,
            window=seen.window,
            sampling=self.sampling,
        )


def render_methods(seen: ReferenceView, fidelity: Fidelity) -> tuple[RenderMethod, ...]:
    """Return the methods measured: all models by samplings, hidden layers by rays.

    Samplings are BANDS by MARGINS, the usual one once more in single precision, and
    the compiler's. Layers that hide one another take the usual sampling.
    """
    grid = [Sampling(band_error=b, margin=m) for b in BANDS for m in MARGINS]
    grid += [_USUAL, replace(_USUAL, single=True), fidelity.sampling]
    grid = list(dict.fromkeys(grid))
    found = [RenderMethod(model=model, sampling=s) for model in MODELS for s in grid]
    if seen.is_layered:
        found += [
            RenderMethod(model=m, sampling=_USUAL, rays=r) for m in MODELS for r in RAYS
        ]
    return tuple(found)


def measure(
    seen: ReferenceView,
    fidelity: Fidelity,
    treatment: str,
    law: ReferenceImages,
    layered: ReferenceImages,
) -> tuple[MeasuredMethod, ...]:
    """Return time and errors of every method, in the order of `render_methods`.

    Parameters
    ----------
    seen : ReferenceView
        What is rendered.
    fidelity : Fidelity
        The compiler's choice, which is measured too.
    treatment : str
        Of layers, one of `microplan.optics.layers.layer_error.TREATMENTS`, chosen too.
    law : ReferenceImages
        Images by the exact model at all focus heights, layers blended.
    layered : ReferenceImages
        Layers traced at the nominal focus.
    """
    poses = _other_poses(seen)
    found = [
        _measured(seen, method, law, layered, poses)
        for method in render_methods(seen, fidelity)
    ]
    chosen = RenderMethod(model=fidelity.model, sampling=fidelity.sampling)
    if treatment == "occluded" and seen.is_layered:
        chosen = RenderMethod(model=fidelity.model, sampling=_USUAL, rays=SAMPLES)
    marked = [
        replace(each, is_choice=method == chosen)
        for method, each in zip(render_methods(seen, fidelity), found, strict=True)
    ]
    # as they are written: what differs less is rounding
    on_law = front([_written(w.time_ms, w.law_max_error) for w in found])
    on_all = front([_written(w.time_ms, w.max_error) for w in found])
    return tuple(
        replace(each, on_law_front=i in on_law, on_front=i in on_all)
        for i, each in enumerate(marked)
    )


def front(pairs: Sequence[tuple[float | None, float | None]]) -> frozenset[int]:
    """Return the indices of the Pareto front: pairs that no other is below in both.

    Pairs with a None take no part.
    """
    known = [
        (x, y, k) for k, (x, y) in enumerate(pairs) if x is not None and y is not None
    ]
    found, least = [], math.inf
    for _, y, index in sorted(known):
        if y < least:
            found.append(index)
            least = y
    return frozenset(found)


def _written(time_ms: float, error: float | None) -> tuple[float, float | None]:
    """Return time and error with the digits of the record."""
    return quantise(time_ms), None if error is None else quantise(error)


def floor_ms(window: Window) -> float:
    """Return the time of a real transform of a region, there and back."""
    image = np.random.default_rng(1).random((window.rows, window.columns))

    def pairs() -> None:
        for _ in range(10):
            fft.irfft2(fft.rfft2(image), s=image.shape)

    return _least_ms(pairs) / 10


def _measured(
    seen: ReferenceView,
    method: RenderMethod,
    law: ReferenceImages,
    layered: ReferenceImages,
    other_poses: Iterator[ReferenceView],
) -> MeasuredMethod:
    """Return a method's time and errors; images in advance make its tables."""
    heights = seen.focus_um[:1] if method.rays else seen.focus_um
    images = np.array([method.image(seen, z) for z in heights])
    off = None if method.rays else np.abs(images - law.images)
    away = np.abs(images[0] - layered.images[0])
    fresh = iter([next(other_poses) for _ in range(REPEATS)])  # made untimed
    return MeasuredMethod(
        model=method.model,
        layers="occluded" if method.rays else "blend",
        band_error=method.sampling.band_error,
        margin=method.sampling.margin,
        float_bits=32 if method.sampling.single else 64,
        rays_per_cell=method.rays,
        time_ms=_least_ms(lambda: method.image(next(fresh), seen.focus_um[0])),
        law_max_error=None if off is None else float(off.max()),
        law_rms_error=None if off is None else max(_rms(each) for each in off),
        max_error=float(away.max()),
        rms_error=_rms(away),
        is_choice=False,
        on_law_front=False,
        on_front=False,
    )


def _other_poses(seen: ReferenceView) -> Iterator[ReferenceView]:
    """Yield the view with all layers moved together, each time farther."""
    for count in itertools.count(1):
        moved = tuple(
            replace(layer, outline=place(layer.outline, count * _STEP_UM, 0.0))
            for layer in seen.scene.layers
        )
        yield replace(seen, scene=replace(seen.scene, layers=moved))


def _least_ms(work: Callable[[], object]) -> float:
    """Return the least time of several calls: what interrupts one counts for nothing.

    Wall time, as some systems count CPU time in steps longer than a call.
    """
    found: list[float] = []
    while len(found) < REPEATS and (len(found) < 2 or sum(found) < _ENOUGH_S):
        start = time.perf_counter()
        work()
        found.append(time.perf_counter() - start)
    return 1e3 * min(found)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
