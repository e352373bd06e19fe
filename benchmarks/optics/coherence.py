"""Partial coherence: what its table, its bound and its source err by, and its time."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.optics.edge_table import edge_row
from benchmarks.timing import cpu_s
from microplan.arrays import FloatArray
from microplan.optics.coherence.coherence import render_coherent
from microplan.optics.coherence.edge_offsets import (
    coherence_error,
    edge_offset_um,
    scene_error,
)
from microplan.optics.coherence.source import SAMPLES, source_error
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.render import render
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from tests.optics.shapes import circle, disc, gear, microscope, one_layer, rectangle

# Between the nodes of the table: middles, and either side of the bend at 1
BETWEEN = (0.05, 0.25, 0.55, 0.85, 0.975, 1.025, 1.15, 1.35, 1.75, 2.5, 6.0)
NEAR_WAVES, FAR_WAVES = (0.125, 0.625), (1.25, 1.75)
BETWEEN_CONTRAST = (0.1, 0.4, 0.6, 0.9)

COHERENCE = (0.1, 0.3, 0.5, 0.7, 1.0, 1.5)
DEFOCUS_UM = (0.0, 5.0, 10.0)
REFLECTANCE = ((1.0, 0.0), (0.25, 0.5))  # of body and background
_QUARTER = Window(row=0, column=0, rows=160, columns=160)  # the others look alike
_SAMPLES = 10  # source_error is .015
_COARSE, _FINEST = (4, 7, 10), 20  # samples compared with what stands for all


def scenes() -> dict[str, Outline]:
    """Return bodies such as a workcell has, um."""
    bore = circle(25.0, hole=True)
    return {
        "gear": gear(),
        "bore": Outline(rings=rectangle(-35.0, -35.0, 35.0, 35.0).rings + (bore,)),
        "pin": disc(10.0),
        "thin pin": disc(2.5),
        "finger": rectangle(-20.0, -1.5, 20.0, 1.5),
    }


def field() -> Outline:
    """Return 81 small discs, which interfere with one another."""
    places = itertools.product(range(-4, 5), repeat=2)
    rings = tuple(circle(2.1, (6.1 * i, 5.3 * j)) for i, j in places)
    return Outline(rings=rings)


def predictions(jobs: int) -> FloatArray:
    """Return what incoherent images err by: measured, predicted, known to; (N, 3)."""
    settings = list(itertools.product(scenes(), COHERENCE, DEFOCUS_UM, REFLECTANCE))
    with ProcessPoolExecutor(jobs) as pool:
        return np.array(list(pool.map(_predicted, settings, chunksize=8)))


def _predicted(
    setting: tuple[str, float, float, tuple[float, float]],
) -> tuple[float, float, float]:
    """Return one image's measured and predicted error and what the truth errs by."""
    name, coherence, z_um, (body, background) = setting
    optics = microscope(20.0, 300, 300)
    layer = Layer(name=name, outline=scenes()[name], z_um=z_um, reflectance=body)
    scene = Scene(layers=(layer,), background=background)
    found = render(scene, optics, focus_um=0.0, window=_QUARTER)
    truth = render_coherent(
        scene,
        optics,
        focus_um=0.0,
        coherence=coherence,
        window=_QUARTER,
        samples=_SAMPLES,
    )
    predicted = scene_error(scene, optics, focus_um=0.0, coherence=coherence)
    known = source_error(_SAMPLES) * abs(body - background)
    return float(np.abs(found - truth).max()), predicted, known


def _edges(jobs: int, all_waves: Sequence[float]) -> tuple[float, float]:
    """Return the worst error of an offset, and of an error over its bound."""
    optics = microscope()
    airy = optics.wavelength_um / optics.aperture
    settings = list(itertools.product(BETWEEN, all_waves))
    with ProcessPoolExecutor(jobs) as pool:
        rows = list(pool.map(partial(edge_row, contrasts=BETWEEN_CONTRAST), settings))
    offset, ratio = 0.0, 0.0
    for (coherence, waves), row in zip(settings, rows, strict=True):
        z_um = waves * optics.wavelength_um / optics.rim_w20_um(1.0)
        half = len(BETWEEN_CONTRAST)
        for c, shift, error in zip(BETWEEN_CONTRAST, row[:half], row[half:],
                                   strict=True):  # fmt: skip
            read = edge_offset_um(coherence, optics, c, z_um) / airy
            offset = max(offset, abs(read - shift * c))
            ratio = max(ratio, error / coherence_error(coherence, optics, c, z_um))
    return offset, ratio


def _source_ratio() -> float:
    """Return the worst error of the source's samples over what is stated."""
    worst = 0.0
    optics = microscope(20.0, 300, 300)
    for outline in (gear(), field(), rectangle(-30.0, -20.0, 30.0, 20.0)):
        for coherence in (0.3, 0.7):
            image = partial(_image, outline, optics, coherence)
            finest = image(_FINEST)
            for samples in _COARSE:
                error = np.abs(image(samples) - finest).max()
                worst = max(worst, float(error) / source_error(samples))
    return worst


def _image(
    outline: Outline, optics: Microscope, coherence: float, samples: int
) -> FloatArray:
    """Return a white body over black, in focus."""
    return render_coherent(
        one_layer(outline), optics, focus_um=0.0, coherence=coherence, samples=samples
    )


def _measure(options: Options) -> Iterator[Figure]:
    """Measure the table between its nodes, the bound on scenes, source and time."""
    near, near_ratio = _edges(options.jobs, NEAR_WAVES)
    far, far_ratio = _edges(options.jobs, FAR_WAVES)
    unit = "wavelength / A"
    yield Figure(name="coherence.max_edge_offset_error", value=near, unit=unit)
    yield Figure(name="coherence.max_edge_offset_error_far", value=far, unit=unit)
    yield Figure(
        name="coherence.edge_error_over_bound",
        value=max(near_ratio, far_ratio),
        unit="1",
    )
    yield Figure(
        name="coherence.source_error_over_bound", value=_source_ratio(), unit="1"
    )
    measured, predicted, known = predictions(options.jobs).T
    yield Figure(
        name="coherence.max_measured_over_predicted",
        value=float((measured / (predicted + known)).max()),
        unit="1",
    )
    yield Figure(
        name="coherence.median_predicted_over_measured",
        value=float(np.median(predicted / measured)),
        unit="1",
    )
    yield _gear_time()


def _gear_time() -> Figure:
    """Return the time of the gear at 640 x 480, coherence .5, beside `render`'s.

    Each image has a pose of its own, so that nothing kept of another serves it.
    """
    optics = microscope(6.9, 640, 480)
    plain = partial(render, microscope=optics, focus_um=0.0)
    full = partial(
        render_coherent, microscope=optics, focus_um=0.0, coherence=0.5, samples=SAMPLES
    )
    poses = [one_layer(place(gear(), k * 1e-3, 0.0)) for k in range(7)]
    plain(poses[0])  # tables
    return Figure(
        name="coherence.gear_ms",
        value=1000 * min(cpu_s(partial(full, pose)) for pose in poses[1:4]),
        unit="ms",
        floor=1000 * min(cpu_s(partial(plain, pose)) for pose in poses[4:]),
    )


BENCHMARK = Benchmark(
    names=(
        "coherence.max_edge_offset_error",
        "coherence.max_edge_offset_error_far",
        "coherence.edge_error_over_bound",
        "coherence.source_error_over_bound",
        "coherence.max_measured_over_predicted",
        "coherence.median_predicted_over_measured",
        "coherence.gear_ms",
    ),
    measure=_measure,
)
