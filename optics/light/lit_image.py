"""Scene to image in any light: coaxial, from below, or from a ring."""

from __future__ import annotations

from collections.abc import Sequence

from microplan.arrays import FloatArray
from microplan.optics.layers.coaxial_light import Irradiance
from microplan.optics.layers.shading import render_coaxial
from microplan.optics.light.lamps import Lamp
from microplan.optics.light.ring import MIDDLE, render_ring
from microplan.optics.light.transmitted import is_clear, render_transmitted
from microplan.optics.render.render import Covered
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Illumination, Scene, Window
from microplan.optics.transfer.microscope import Microscope

_USUAL = Sampling()


def render_lit(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    lamp_aperture: float | None = None,
    ring: Lamp = None,
    line: float = MIDDLE,
    model: str = "exact",
    window: Window | None = None,
    light: Illumination | None = None,
    also: Sequence[Covered] = (),
    under: Sequence[Irradiance] | None = None,
    sampling: Sampling = _USUAL,
) -> FloatArray:
    """Return the noise-free image of a scene, (rows, columns), share of full scale.

    Parameters
    ----------
    lamp_aperture, under
        As in `microplan.optics.layers.shading.render_coaxial`.
    ring, line
        As in `microplan.optics.light.ring.render_ring`.
    scene, microscope, focus_um, model, window, light, also, sampling
        As in `microplan.optics.render.render.render`. Clear layers are seen by
        `microplan.optics.light.transmitted.render_transmitted`.

    Raises
    ------
    ValueError
        As these do.
    """
    if ring is not None:
        return render_ring(
            scene,
            microscope,
            focus_um=focus_um,
            lamp=ring,
            line=line,
            model=model,
            window=window,
            light=light,
            also=also,
            sampling=sampling,
        )
    if is_clear((*scene.layers, *(c.layer for c in also))):
        return render_transmitted(
            scene,
            microscope,
            focus_um=focus_um,
            model=model,
            window=window,
            light=light,
            also=also,
            sampling=sampling,
        )
    return render_coaxial(
        scene,
        microscope,
        focus_um=focus_um,
        lamp_aperture=lamp_aperture,
        model=model,
        window=window,
        light=light,
        also=also,
        under=under,
        sampling=sampling,
    )
