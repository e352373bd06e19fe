"""Whole frames of a state, as the camera of the workcell would show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from optics.lensing import lens_scene
from optics.microscope import Microscope
from optics.sampling import Sampling
from optics.scene import Illumination, Scene
from optics.shading import shaded
from optics.views import full
from planner.caching.memo import EVERY_TIME, Memo
from planner.inputs.workcell import Workcell
from planner.lens import known_errors, lamp_aperture
from planner.model.scenes import relevant

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
