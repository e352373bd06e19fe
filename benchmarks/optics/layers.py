"""Layers of the example over each other: traced, blended, predicted, and by waves.

The reference traces 8 times as many rays, other ones, through cells of half the side,
over layers blurred with all of the band and a wider margin, around the place where two
sets of rays differ most. Blending is compared with the larger of those sets everywhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import numpy as np

from benchmarks.example import TASK
from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.optics import layer_waves
from benchmarks.timing import cpu_s
from microplan.arrays import FloatArray
from microplan.optics.layers.layer_error import layer_error
from microplan.optics.layers.occlusion import SAMPLES, Tracing, cell_um, occluded
from microplan.optics.layers.rays import slopes
from microplan.optics.render.render import Covered, cover, render
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Scene, Window
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.assembly.step_states import unfold
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.read_task import load_task
from microplan.planner.views.light.layer_reach import relevant
from microplan.planner.views.scenes import world_scene
from tests.optics.shapes import microscope

STEPS = ("grasp", "over_shaft")
MAGNIFICATIONS = (6.9, 44.5)
SIDE_PX = 300
PATCH_PX = 32  # compared, around where other rays differ most
KINDS = (
    "occluded_error",
    "occluded_predicted",
    "blend_error",
    "blend_predicted",
    "occluded_ms",
)
_FINEST = Sampling(band_error=1e-12, margin=80.0)


def _measure(_options: Options) -> Iterator[Figure]:
    worst = 0.0
    for step in STEPS:
        scene = example_scene(step)
        for magnification in MAGNIFICATIONS:
            optics = microscope(magnification, SIDE_PX, SIDE_PX)
            found = [compare(scene, optics, z) for z in focuses(scene, optics)]
            worst = max(worst, *(each["occluded_error"] for each in found))
            for kind in KINDS:
                yield Figure(
                    name=f"layers.{step}.m{magnification:g}.{kind}",
                    value=max(each[kind] for each in found),
                    unit="ms" if kind.endswith("_ms") else "full scale",
                    floor=_render_ms(found) if kind.endswith("_ms") else None,
                )
    yield Figure(name="layers.max_error", value=worst, unit="full scale")
    yield from layer_waves.measure()


BENCHMARK = Benchmark(
    names=(
        *(
            f"layers.{step}.m{m:g}.{kind}"
            for step in STEPS
            for m in MAGNIFICATIONS
            for kind in KINDS
        ),
        "layers.max_error",
        *layer_waves.NAMES,
    ),
    measure=_measure,
)


def example_scene(step: str) -> Scene:
    """Return the example's scene after a step."""
    report = Report()
    task = load_task(TASK, report)
    if task is None:
        raise RuntimeError(f"{TASK} cannot be read: {list(report.found)}")
    state = next(s.after for s in unfold(task, report) if s.step.id == step)
    return world_scene(task, state)


def focuses(scene: Scene, optics: Microscope) -> list[float]:
    """Return the heights of the layers in view, and the middles between them."""
    frame = Window(row=0, column=0, rows=SIDE_PX, columns=SIDE_PX)
    seen = relevant(scene.layers, optics, 0.0, frame)
    heights = sorted({layer.z_um for layer in seen if layer.z_um > -100})
    return sorted([*heights, *((a + b) / 2 for a, b in pairwise(heights))])


def compare(scene: Scene, optics: Microscope, focus_um: float) -> dict[str, float]:
    """Return errors against the reference, predictions and times at one focus."""
    images: list[FloatArray] = []
    blend_s = cpu_s(lambda: images.append(render(scene, optics, focus_um=focus_um)))
    traced_s = cpu_s(lambda: images.append(occluded(scene, optics, focus_um=focus_um)))
    blended, traced = images
    # other rays differ most where there are too few of them
    other = occluded(scene, optics, focus_um=focus_um, samples=2 * SAMPLES + 1)
    row, column = np.unravel_index(np.abs(traced - other).argmax(), traced.shape)
    patch = Window(
        row=_start(int(row)), column=_start(int(column)), rows=PATCH_PX,
        columns=PATCH_PX,
    )  # fmt: skip
    truth = reference(scene, optics, focus_um, patch)
    part = (
        slice(patch.row, patch.row + PATCH_PX),
        slice(patch.column, patch.column + PATCH_PX),
    )
    predict = partial(layer_error, scene, optics, focus_um=focus_um)
    return {
        "occluded_error": float(np.abs(traced[part] - truth).max()),
        "occluded_predicted": predict(treatment="occluded"),
        "blend_error": float(np.abs(blended - other).max()),
        "blend_predicted": predict(treatment="blend"),
        "occluded_ms": 1000 * traced_s,
        "blend_ms": 1000 * blend_s,
    }


def reference(
    scene: Scene, optics: Microscope, focus_um: float, patch: Window
) -> FloatArray:
    """Return a patch traced with finer cells and many more rays."""

    def blurred(fine: Microscope, cut: Window) -> tuple[Covered, ...]:
        return cover(
            scene.layers, fine, focus_um=focus_um, window=cut, sampling=_FINEST
        )

    tracing = Tracing(
        scene=scene,
        microscope=optics,
        focus_um=focus_um,
        model="exact",
        tangents=slopes(optics, 8 * SAMPLES + 1),
        step_um=cell_um(scene.layers, optics) / 2,
    )
    return tracing.image(patch, blurred)


def _start(middle: int) -> int:
    return min(max(middle - PATCH_PX // 2, 0), SIDE_PX - PATCH_PX)


def _render_ms(found: list[dict[str, float]]) -> float:
    """Return the time of blending at the same foci."""
    return max(each["blend_ms"] for each in found)
