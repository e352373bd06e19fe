"""Image errors that depend on what the walls of solid bodies mirror."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from microplan.optics.layers.shading import render_coaxial, shade_error
from microplan.optics.render.fidelity import rounded_up
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Scene, Window
from microplan.optics.transfer.microscope import Microscope

_FINER = 1.5  # times closer points
# Of the error, what they change: thrice it if that falls with the distance of points,
# .7 of it if it is of rays that miss one another.
_SAFE = 2.0


def wall_error(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    lamp_aperture: float,
    window: Window | None = None,
) -> float:
    """Return the largest image error of points about walls that lie too far apart.

    Parameters
    ----------
    scene, microscope, focus_um, lamp_aperture, window
        As in `microplan.optics.layers.shading.render_coaxial`.

    Returns
    -------
    float
        Share of full scale, two digits, rounded up: twice what closer points change.
    """
    usual, close = (
        render_coaxial(
            scene,
            microscope,
            focus_um=focus_um,
            lamp_aperture=lamp_aperture,
            window=window,
            sampling=Sampling(rays=finer),
        )
        for finer in (1.0, _FINER)
    )
    return rounded_up(_SAFE * float(np.abs(close - usual).max()))


def most_shade_error(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    lamp_aperture: float,
    window: Window | None = None,
) -> float:
    """Return the image error of leaving out the shade, as if no wall mirrored too.

    Walls that mirror give back what shade takes, and the errors of both stay.

    Parameters
    ----------
    scene, microscope, focus_um, lamp_aperture, window
        As in `microplan.optics.layers.shading.render_coaxial`.

    Returns
    -------
    float
        Share of full scale, two digits, rounded up: the larger `shade_error` of the
        scene as it is and with black walls.
    """
    black = tuple(replace(each, wall_reflectance=0.0) for each in scene.layers)
    scenes = [scene]
    if black != tuple(scene.layers):
        scenes.append(replace(scene, layers=black))
    return max(
        shade_error(
            each,
            microscope,
            focus_um=focus_um,
            lamp_aperture=lamp_aperture,
            window=window,
        )
        for each in scenes
    )
