"""Ways of computing one look's image: their times, and their errors by the oracle."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy import fft

from optics.fidelity import Fidelity, Pilot
from optics.microscope import Microscope
from optics.models import MODELS
from optics.occlusion import SAMPLES, Tracing, cell_um, meeting, occluded
from optics.oracle import Oracle
from optics.rays import Sheet, sheets, slopes
from optics.render import Covered, cover, render, render_stack
from optics.sampling import BAND_ERROR, MARGIN, Sampling
from optics.scene import Scene, Window
from optics.spectrum import band_orders
from planner.outputs.tradeoff import Measured
from schemas.codec import quantise

FloatArray = npt.NDArray[np.float64]

BANDS = (5e-3, 5e-4, 5e-5)  # from what nobody sees to what tables err
MARGINS = (10.0, 40.0)
RAYS = (SAMPLES // 4, SAMPLES)  # a cell, of occluded layers
REPEATS = 3  # of which the least time counts; 2 where they take long
_ENOUGH_S = 0.1
_USUAL = Sampling(band_error=BAND_ERROR, margin=MARGIN)
_WHOLE = 1e-12  # band error that leaves nothing out
_WIDER = 2.0  # the oracle's margin over the widest that is measured
# Waves times edges that the closed form may take; a billion take about a minute.
_SLOWEST = 2.5e8
_TRACED = 4096  # the oracle's rays a cell; a quarter of them shows what they err
_TRACED_BAND = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """What one look sees, and the focus heights an image of it must be right at."""

    scene: Scene
    microscope: Microscope
    window: Window
    focus_um: tuple[float, ...]  # the nominal one first

    @property
    def is_layered(self) -> bool:
        """Tell whether layers of different height are in view."""
        return len({layer.z_um for layer in self.scene.layers}) > 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """Reference images of a look."""

    images: FloatArray  # (focus heights, rows, columns), share of full scale
    name: str  # what they are
    error: float  # how far they may be off, of unit contrast


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """One way of computing an image."""

    model: str
    sampling: Sampling
    rays: int = 0  # 0: layers are blended

    def image(self, sight: Sight, focus_um: float) -> FloatArray:
        """Return the image, (rows, columns)."""
        if self.rays:
            return occluded(
                sight.scene,
                sight.microscope,
                focus_um=focus_um,
                model=self.model,
                window=sight.window,
                samples=self.rays,
            )
        return render(
            sight.scene,
            sight.microscope,
            focus_um=focus_um,
            model=self.model,
            window=sight.window,
            sampling=self.sampling,
        )


def ways(sight: Sight, fidelity: Fidelity) -> tuple[Way, ...]:
    """Return what is measured: all laws by samplings, and hidden layers by rays.

    Samplings are BANDS by MARGINS, the usual one once more in single precision, and
    the compiler's. Layers that hide one another take the usual sampling.
    """
    grid = [Sampling(band_error=b, margin=m) for b in BANDS for m in MARGINS]
    grid += [_USUAL, replace(_USUAL, single=True), fidelity.sampling]
    grid = list(dict.fromkeys(grid))
    found = [Way(model=model, sampling=s) for model in MODELS for s in grid]
    if sight.is_layered:
        found += [Way(model=m, sampling=_USUAL, rays=r) for m in MODELS for r in RAYS]
    return tuple(found)


def measure(
    sight: Sight, fidelity: Fidelity, treatment: str, law: Truth, layered: Truth
) -> tuple[Measured, ...]:
    """Return time and errors of every way, in the order of `ways`.

    Parameters
    ----------
    sight : Sight
        What is rendered.
    fidelity : Fidelity
        The compiler's choice, which is measured too.
    treatment : str
        Of layers, one of `optics.layer_error.TREATMENTS`, chosen too.
    law : Truth
        The exact law at all focus heights, layers blended.
    layered : Truth
        Layers traced at the nominal focus.
    """
    found = [_measured(sight, way, law, layered) for way in ways(sight, fidelity)]
    chosen = Way(model=fidelity.model, sampling=fidelity.sampling)
    if treatment == "occluded" and sight.is_layered:
        chosen = Way(model=fidelity.model, sampling=_USUAL, rays=SAMPLES)
    marked = [
        replace(each, is_choice=way == chosen)
        for way, each in zip(ways(sight, fidelity), found, strict=True)
    ]
    # as they are written: what differs less is rounding
    on_law = front([_written(w.time_ms, w.law_max_error) for w in found])
    on_all = front([_written(w.time_ms, w.max_error) for w in found])
    return tuple(
        replace(each, on_law_front=i in on_law, on_front=i in on_all)
        for i, each in enumerate(marked)
    )


def front(points: Sequence[tuple[float, float | None]]) -> frozenset[int]:
    """Return the indices of points that no other betters in time and in error.

    Points without an error take no part.
    """
    known = [(t, e, i) for i, (t, e) in enumerate(points) if e is not None]
    found, best = [], np.inf
    for _, error, index in sorted(known):
        if error < best:
            found.append(index)
            best = error
    return frozenset(found)


def _written(time_ms: float, error: float | None) -> tuple[float, float | None]:
    """Return time and error with the digits of the record."""
    return quantise(time_ms), None if error is None else quantise(error)


def law_truth(sight: Sight, margin: float) -> Truth:
    """Return the exact law at all focus heights, layers blended.

    Parameters
    ----------
    sight : Sight
        What is rendered.
    margin : float
        The widest that is measured, in wavelengths / A.

    Returns
    -------
    Truth
        Of one layer, and if that does not take minutes, by the closed form of
        `optics.oracle`; else by all of the band and twice the margin.
    """
    if len(sight.scene.layers) == 1:
        (layer,) = sight.scene.layers
        depths = [layer.z_um - z for z in sight.focus_um]
        oracle = Oracle.of(
            layer.outline,
            sight.microscope,
            window=sight.window,
            deepest_um=max(map(abs, depths)),
        )
        if _work(oracle) <= _SLOWEST:
            step = layer.reflectance - sight.scene.background
            covers = oracle.images([("exact", depth) for depth in depths])
            return Truth(
                images=sight.scene.background + step * covers,
                name="closed form, every wave of the band",
                error=abs(step) * oracle.wrap_error,
            )
    far = _WIDER * margin
    wide = Sampling(band_error=_WHOLE, margin=far, near=far)  # nothing is made up for
    images = render_stack(
        sight.scene,
        sight.microscope,
        focus_um=sight.focus_um,
        window=sight.window,
        sampling=wide,
    )
    pilot = Pilot(scene=sight.scene, microscope=sight.microscope, window=sight.window)
    return Truth(
        images=images,
        name="the exact law with all of the band and twice the margin",
        error=pilot.rest(wide.margin),
    )


def layer_truth(sight: Sight, law: Truth, margin: float) -> Truth:
    """Return the image at the nominal focus with layers that hide one another.

    As `optics.occlusion.occluded`, with more rays, and a wide band and `margin`: what
    lies between blurred edges of different height is traced, the rest is as blended.
    """
    part = meeting(_sheets(sight, margin))
    if part is None:
        return Truth(images=law.images[:1], name=law.name, error=law.error)
    side = cell_um(sight.scene.layers, sight.microscope)
    crop = _piece(sight.window, part)
    fine = _traced(sight, crop, margin, rays=_TRACED, step_um=side)
    coarse = _traced(sight, crop, margin, rays=_TRACED // 4, step_um=2 * side)
    images = law.images[:1].copy()
    images[0][part] = fine
    return Truth(
        images=images,
        name=f"layers traced by {_TRACED} rays a cell",
        error=max(float(np.abs(fine - coarse).max()), law.error),
    )


def floor_ms(window: Window) -> float:
    """Return the CPU time of a real transform of a region, there and back."""
    image = np.random.default_rng(1).random((window.rows, window.columns))

    def pairs() -> None:
        for _ in range(10):
            fft.irfft2(fft.rfft2(image), s=image.shape)

    return _least_ms(pairs) / 10


def _measured(sight: Sight, way: Way, law: Truth, layered: Truth) -> Measured:
    """Return a way's time and errors; images in advance make its tables."""
    heights = sight.focus_um[:1] if way.rays else sight.focus_um
    images = np.array([way.image(sight, z) for z in heights])
    off = None if way.rays else np.abs(images - law.images)
    away = np.abs(images[0] - layered.images[0])
    return Measured(
        model=way.model,
        layers="occluded" if way.rays else "blend",
        band_error=way.sampling.band_error,
        margin=way.sampling.margin,
        float_bits=32 if way.sampling.single else 64,
        rays_per_cell=way.rays,
        time_ms=_least_ms(partial(way.image, sight, sight.focus_um[0])),
        law_max_error=None if off is None else float(off.max()),
        law_rms_error=None if off is None else max(_rms(each) for each in off),
        max_error=float(away.max()),
        rms_error=_rms(away),
        is_choice=False,
        on_law_front=False,
        on_front=False,
    )


def _sheets(sight: Sight, margin: float) -> list[Sheet]:
    """Return what covers the pixels at each height, in the nominal focus."""
    covered = _covered(sight, sight.microscope, sight.window, margin)
    return sheets([c.layer for c in covered], [c.coverage for c in covered])


def _covered(
    sight: Sight, setting: Microscope, cut: Window, margin: float
) -> tuple[Covered, ...]:
    """Return the layers blurred by the exact law in the nominal focus."""
    return cover(
        sight.scene.layers,
        setting,
        focus_um=sight.focus_um[0],
        window=cut,
        sampling=Sampling(band_error=_TRACED_BAND, margin=margin),
    )


def _piece(frame: Window, part: tuple[slice, slice]) -> Window:
    """Return rows and columns of a window as a window."""
    return Window(
        row=frame.row + part[0].start,
        column=frame.column + part[1].start,
        rows=part[0].stop - part[0].start,
        columns=part[1].stop - part[1].start,
    )


def _traced(
    sight: Sight, crop: Window, margin: float, *, rays: int, step_um: float
) -> FloatArray:
    """Return the image of a crop with every ray traced."""

    tracing = Tracing(
        scene=sight.scene,
        microscope=sight.microscope,
        focus_um=sight.focus_um[0],
        model="exact",
        tangents=slopes(sight.microscope, rays),
        step_um=step_um,
    )
    return tracing.image(
        crop, lambda setting, cut: _covered(sight, setting, cut, margin)
    )


def _work(oracle: Oracle) -> float:
    """Return the waves times the edges of an oracle's image."""
    J, K = band_orders(oracle.tile, oracle.microscope.cutoff_per_um)
    edges = len(oracle.edges.segments) + len(oracle.edges.arcs)
    return float(edges * (J + 1) * (2 * K + 1))


def _least_ms(work: Callable[[], object]) -> float:
    """Return the least CPU time of several calls: other processes count for nothing."""
    found: list[float] = []
    while len(found) < REPEATS and (len(found) < 2 or sum(found) < _ENOUGH_S):
        start = time.process_time()
        work()
        found.append(time.process_time() - start)
    return 1e3 * min(found)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
