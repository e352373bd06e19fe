"""Coaxial light: images against traced ones, what they cost, and what is told of them.

Both the images and the traced ones are taken less the same without shade, so that what
blending errs by where edges of two heights meet is left out; the part of it that is
shaded is not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.timing import best_s, once_s
from microplan.arrays import FloatArray
from microplan.optics.layers.occlusion import occluded
from microplan.optics.layers.shading import render_coaxial, shade_error
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.render import render
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope
from tests.optics.shapes import disc, gear, microscope, rectangle

Case = tuple[Scene, float]  # a scene over a stage, and the height in focus

LAMP = 0.42
_PAIRS = 12
_TIMES = 20
_WINDOW = Window(row=200, column=270, rows=80, columns=100)
_PART = Window(row=210, column=290, rows=60, columns=60)


def _layer(name: str, outline: Outline, z_um: float, reflectance: float) -> Layer:
    return Layer(name=name, outline=outline, z_um=z_um, reflectance=reflectance)


def grasp() -> Scene:
    """Return the example's gear between its fingers, over the stage."""
    fingers = (
        _layer(name, rectangle(x, -60, x + 100, 2000), 230.0, 0.7)
        for name, x in (("left", -165.0), ("right", 65.0))
    )
    layers = (_layer("gear", gear(), 100.0, 0.8), *fingers)
    return Scene(layers=layers, background=0.1, background_z_um=0.0)


def over_shaft() -> Scene:
    """Return the example's gear 10 um above its post."""
    layers = (
        _layer("gear", gear(), 250.0, 0.8),
        _layer("post", disc(22.0, (3.0, 0.0)), 240.0, 0.75),
    )
    return Scene(layers=layers, background=0.15, background_z_um=0.0)


def example() -> Iterator[Case]:
    """Yield the example's scenes in and out of focus."""
    for focus_um in (60.0, 100.0, 160.0, 230.0):
        yield grasp(), focus_um
    for focus_um in (240.0, 245.0, 250.0):
        yield over_shaft(), focus_um


def pairs(count: int, seed: int = 11) -> Iterator[Case]:
    """Yield random bodies over a bright stage, in focus anywhere between and near."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        z_um = 10 ** rng.uniform(0.7, 2.3)
        size = float(rng.uniform(8, 40))
        outline = (
            disc(size),
            rectangle(-size, -size / 2, size, size),
            place(gear(), -40.0, 0.0),
        )[int(rng.integers(3))]
        x, y, theta = rng.uniform(-10, 10), rng.uniform(-10, 10), rng.uniform(0, 3)
        body = place(outline, x, y, theta)
        scene = Scene(
            layers=(_layer("body", body, z_um, rng.uniform(0, 0.3)),),
            background=rng.uniform(0.5, 1),
            background_z_um=0.0,
        )
        yield scene, float(rng.choice([0.0, z_um, rng.uniform(-0.3, 1.3) * z_um]))


def _on_floor(scene: Scene) -> Scene:
    """Return a scene whose stage is a wide layer: tracing shades no background."""
    wide = rectangle(-900, -900, 900, 900)
    floor = _layer("floor", wide, scene.background_z_um or 0.0, scene.background)
    return Scene(layers=(floor, *scene.layers), background=0.0)


def off(case: Case, optics: Microscope, window: Window) -> FloatArray:
    """Return the change of an image by shade, less that of a traced one."""
    scene, focus_um = case
    floor = _on_floor(scene)
    light = render_coaxial(
        scene, optics, focus_um=focus_um, lamp_aperture=LAMP, window=window
    ) - render(scene, optics, focus_um=focus_um, window=window)
    traced = occluded(
        floor, optics, focus_um=focus_um, lamp_aperture=LAMP, window=window
    ) - occluded(floor, optics, focus_um=focus_um, window=window)
    change: FloatArray = np.abs(light - traced)
    return change


def _moved(scene: Scene, right_um: float) -> Scene:
    """Return a scene with all its layers moved together."""
    layers = (
        replace(each, outline=place(each.outline, right_um, 0.0))
        for each in scene.layers
    )
    return replace(scene, layers=tuple(layers))


def _told(case: Case, optics: Microscope, window: Window) -> float:
    """Return `shade_error` over the largest change that shade makes."""
    scene, focus_um = case
    change = render_coaxial(
        scene, optics, focus_um=focus_um, lamp_aperture=LAMP, window=window
    ) - render(scene, optics, focus_um=focus_um, window=window)
    told = shade_error(
        scene, optics, focus_um=focus_um, lamp_aperture=LAMP, window=window
    )
    return told / float(np.abs(change).max())


def _measure(_options: Options) -> Iterator[Figure]:
    optics = microscope(6.9, 640, 480)
    for name, cases, window in (
        ("example", list(example()), _WINDOW),
        ("pairs", list(pairs(_PAIRS)), _PART),
    ):
        errors = [off(case, optics, window) for case in cases]
        worst = max(float(e.max()) for e in errors)
        typical = float(np.median([math.sqrt(np.mean(e**2)) for e in errors]))
        told = min(_told(case, optics, window) for case in cases)
        yield Figure(name=f"shading.{name}.worst_error", value=worst, unit="1")
        yield Figure(name=f"shading.{name}.typical_rms", value=typical, unit="1")
        yield Figure(name=f"shading.{name}.least_told", value=told, unit="1")
    yield _time(optics)


def _time(optics: Microscope) -> Figure:
    """Time 100 x 100 pixels of the grasp; the floor is rendering, the rival tracing.

    Each image has a pose of its own, so that nothing kept of another serves it.
    """
    window, focus_um = replace(_WINDOW, rows=100), 100.0
    poses = iter([_moved(grasp(), k * 1e-3) for k in range(_TIMES * 2)])

    def ours() -> FloatArray:
        return render_coaxial(
            next(poses), optics, focus_um=focus_um, lamp_aperture=LAMP, window=window
        )

    def plain() -> FloatArray:
        return render(next(poses), optics, focus_um=focus_um, window=window)

    def traced() -> FloatArray:
        floor = _on_floor(grasp())
        return occluded(
            floor, optics, focus_um=focus_um, lamp_aperture=LAMP, window=window
        )

    return Figure(
        name="shading.image_s",
        value=best_s(ours, _TIMES),
        unit="s",
        floor=best_s(plain, _TIMES),
        rival=once_s(traced),
    )


BENCHMARK = Benchmark(
    names=(
        *(
            f"shading.{cases}.{what}"
            for cases in ("example", "pairs")
            for what in ("worst_error", "typical_rms", "least_told")
        ),
        "shading.image_s",
    ),
    measure=_measure,
)
