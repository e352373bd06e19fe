"""Whole frames of a state, as the camera of the workcell would show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from optics.layers.shading import shaded
from optics.lens.distorted_scene import lens_scene
from optics.render.sampling import Sampling
from optics.render.scene import Illumination, Scene
from optics.render.view_range import full
from optics.transfer.microscope import Microscope
from planner.store.memo import EVERY_TIME, Memo
from planner.task.workcell import Workcell
from planner.views.lens_errors import known_errors, lamp_aperture
from planner.views.scenes import relevant

FloatArray = npt.NDArray[np.float64]


def seen_scene(
    cell: Workcell, scene: Scene, scope: Microscope, focus_um: float
) -> Scene:
    """Return what of the world reaches the frame, as the lens shows it."""
    layers = relevant(scene.layers, scope, focus_um, full(scope))
    return lens_scene(
        replace(scene, layers=layers), scope, known_errors(cell), focus_um
    )


def frame(
    cell: Workcell,
    scene: Scene,
    scope: Microscope,
    *,
    focus_um: float,
    level: float,
    model: str = "exact",
    sampling: Sampling | None = None,
    memo: Memo = EVERY_TIME,
) -> FloatArray:
    """Return the noise-free frame of a scene by `seen_scene`, (rows, columns).

    Coaxial light is shaded by higher bodies.
    """
    return memo.call(
        shaded,
        scene,
        scope,
        focus_um=focus_um,
        lamp_aperture=lamp_aperture(cell, scope),
        model=model,
        light=Illumination(gain=level),
        sampling=sampling or Sampling(),
    )
