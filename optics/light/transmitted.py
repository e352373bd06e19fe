"""Images in light from below: what bodies let through of each ray.

Opaque bodies before a bright field are layers that send nothing: blending, joint
occlusion and walls are those of `microplan.optics.layers.shading`. A clear body lets a
share t of a ray pass where it is met: the image is t times that without the body and
1 - t times that with it opaque, body by body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from microplan.arrays import FloatArray
from microplan.optics.layers.shading import render_coaxial
from microplan.optics.render.render import Covered, cover
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.render.view_range import full
from microplan.optics.transfer.microscope import Microscope

MOST_CLEAR = 6  # clear bodies with an edge in view: each doubles the images
_EVEN = 1e-3  # coverage so near 0 or 1 all over a window is an even one
_USUAL = Sampling()


def is_clear(layers: Sequence[Layer]) -> bool:
    """Return whether any layer lets light through."""
    return any(layer.transmittance > 0 for layer in layers)


def render_transmitted(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    model: str = "exact",
    window: Window | None = None,
    light: Illumination | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
    also: Sequence[Covered] = (),
    sampling: Sampling = _USUAL,
) -> FloatArray:
    """Return the noise-free image of a scene before a bright field.

    Parameters
    ----------
    scene : Scene
        Its layers send nothing; its background is the bright field: the stage's
        transmittance times the share of the pupil that the lamp fills.
    microscope : Microscope
        With the lamp's aperture, beyond which rays are dark.
    focus_um, model, window, light, shift_um, also, sampling
        As in `microplan.optics.render.render.render`.

    Returns
    -------
    (rows, columns) float64 array
        Share of full scale, not clipped.

    Raises
    ------
    ValueError
        As in `microplan.optics.render.render.render`, or if more than `MOST_CLEAR`
        clear bodies have edges in view.
    """
    frame = window or full(microscope)
    fresh = cover(
        scene.layers,
        microscope,
        focus_um=focus_um,
        model=model,
        window=frame,
        shift_um=shift_um,
        sampling=sampling,
    )
    everything = (*also, *fresh)
    factor, clear, opaque = 1.0, list[Covered](), list[Covered]()
    for each in everything:
        t = each.layer.transmittance
        if t == 0:
            opaque.append(each)
        elif each.coverage.min() > 1 - _EVEN:
            factor *= t
        elif each.coverage.max() > _EVEN and t < 1:
            clear.append(each)
    if len(clear) > MOST_CLEAR:
        raise ValueError(
            f"at most {MOST_CLEAR} clear bodies may have edges in view, got "
            f"{len(clear)}"
        )
    bare = replace(scene, layers=())

    def seen(left: list[Covered], met: tuple[Covered, ...]) -> FloatArray:
        if left:
            first, *rest = left
            t = first.layer.transmittance
            return t * seen(rest, met) + (1 - t) * seen(rest, (*met, first))
        return render_coaxial(
            bare,
            microscope,
            focus_um=focus_um,
            lamp_aperture=None,
            model=model,
            window=frame,
            light=light,
            shift_um=shift_um,
            also=(*opaque, *met),
            sampling=sampling,
        )

    return factor * seen(clear, ())
