"""Images in coaxial light, where higher bodies shade lower ones.

`microplan.optics.layers.occlusion` traces such images ray by ray; here each layer is
blurred together with the light that reaches it, and blended as in
`microplan.optics.render.render`. What several bodies hide together is added.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.coaxial_light import (
    Irradiance,
    area_um,
    irradiances,
    pixel_axes_um,
)
from microplan.optics.layers.mirrors.images import free_of_images, mirror_images
from microplan.optics.layers.mirrors.narrow_lamp import LitPart, lit_parts
from microplan.optics.layers.shaded_view import ShadedFace, ShadedView
from microplan.optics.layers.solids.light_change import light_changes, solid_share
from microplan.optics.layers.wall_view import wall_residual
from microplan.optics.layers.wide_blur import cover_few
from microplan.optics.outline.tolerant_order import MARGIN
from microplan.optics.render.fidelity import rounded_up
from microplan.optics.render.layer_blending import blend_layers, light_up
from microplan.optics.render.render import Covered, cover, render
from microplan.optics.render.sampling import ROUGH, Sampling
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.render.view_range import full
from microplan.optics.transfer.microscope import Microscope

# What `render_coaxial` errs by at most against traced images
# (`benchmarks/optics/shading.py`), but for edges where blending itself errs.
SHADED_ERROR = 0.014
_USUAL = Sampling()
_PROBES = 64  # large pixels a side
_FAR = 2.25  # power of `Sampling.rays` for light on what mirrored rays alone come to


def render_coaxial(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    lamp_aperture: float | None,
    model: str = "exact",
    window: Window | None = None,
    light: Illumination | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
    also: Sequence[Covered] = (),
    under: Sequence[Irradiance] | None = None,
    sampling: Sampling = _USUAL,
) -> FloatArray:
    """Return the noise-free image of a scene in coaxial light.

    Parameters
    ----------
    scene, microscope, focus_um, model, window, light, shift_um, also, sampling
        As in `microplan.optics.render.render.render`.
    lamp_aperture : float
        Numerical aperture of the light through the objective, in (0, n); None for
        light from elsewhere, which nothing shades.
    under : sequence of Irradiance, optional
        The light that the layers of `also` leave at every height that is seen, by
        `microplan.optics.layers.coaxial_light.irradiances`. Default: it is computed.

    Returns
    -------
    (rows, columns) float64 array
        Share of full scale, not clipped. That of `render`, bit by bit, where nothing
        shades what is seen, no two bodies out of focus hide the same rays, and the lamp
        fills what mirrors show of the pupil (`mirrors.narrow_lamp`).

    Raises
    ------
    ValueError
        As in `render`, if the aperture is not in (0, n), or if `under` lacks a height
        or belongs to a smaller window or less defocus.

    Notes
    -----
    With B the blur of a layer's height, 1 its indicator and S the share of light that
    reaches it, a layer adds B[1 S] instead of B[1], which is B[1] B[S] and little
    else. That, and what bodies hide and shade together, is added from rays on few
    points: the mean of their product less the product of their means
    (`microplan.optics.layers.joint`). Bodies near focus multiply it, and are
    traced on the pixels about their edges. Against traced images of the examples' looks
    the image differs by .010 at most, .0014 rms. Shade in a layer of a pixel or less
    about an edge is treated as a mean over the pixel. Diffraction of the lamp's light,
    and between bodies, is left out.
    """
    frame = window or full(microscope)
    blurred = partial(
        cover, focus_um=focus_um, model=model, window=frame, shift_um=shift_um,
        sampling=sampling,
    )  # fmt: skip
    whole = LitPart(scene=scene, microscope=microscope, also=also)
    image, *more = (
        _image(
            part, focus_um=focus_um, lamp_aperture=lamp_aperture, model=model,
            frame=frame, shift_um=shift_um, under=under, sampling=sampling,
        )
        for part in lit_parts(whole, lamp_aperture, blurred)
    )  # fmt: skip
    for each in more:
        image += each
    light_up(image, microscope, frame, light or Illumination())
    return image


def _image(
    part: LitPart,
    *,
    focus_um: float,
    lamp_aperture: float | None,
    model: str,
    frame: Window,
    shift_um: tuple[float, float],
    under: Sequence[Irradiance] | None,
    sampling: Sampling,
) -> FloatArray:
    """Return an image in light of gain 1; mirrors send light to all its rays."""
    scene, microscope = part.scene, part.microscope
    fresh = cover_few(
        scene.layers,
        microscope,
        focus_um=focus_um,
        model=model,
        window=frame,
        shift_um=shift_um,
        sampling=sampling,
    )
    view = ShadedView(
        microscope=microscope,
        focus_um=focus_um,
        model=model,
        frame=frame,
        shift_um=shift_um,
        rays=sampling.rays,
        walls=sampling.walls,
        few_points=sampling.few_points,
    )
    everything = (*part.also, *fresh)
    faces: dict[float, ShadedFace] = {}
    if lamp_aperture is not None:
        faces = _shaded(scene, view, everything, fresh, under, lamp_aperture)
        faces = _with_images(faces, view, [c.layer for c in everything], sampling)
    patches = [
        c.patch(view.lit(c, faces[c.layer.z_um]) if c.layer.z_um in faces else None)
        for c in everything
    ]
    image = np.empty((frame.rows, frame.columns))
    blend_layers(image, patches, _background(scene, faces))
    if sampling.rays == 0:
        return image
    lamp = replace(microscope, aperture=lamp_aperture or microscope.aperture)
    few = min(sampling.rays, sampling.rays**_FAR)
    far_light = partial(
        solid_share, [c.layer for c in everything], lamp=lamp, finer=few
    )
    for change in (
        view.residual(scene, everything, faces),
        wall_residual(view, scene, everything, faces, far_light),
    ):
        if change is not None:
            image += change
    return image


def _shaded(
    scene: Scene,
    view: ShadedView,
    everything: Sequence[Covered],
    fresh: Sequence[Covered],
    under: Sequence[Irradiance] | None,
    lamp_aperture: float,
) -> dict[float, ShadedFace]:
    """Return the faces that are shaded, by height."""
    m = view.microscope
    found = irradiances(
        [c.layer for c in (everything if under is None else fresh)],
        _heights(scene, everything),
        m,
        lamp_aperture=lamp_aperture,
        focus_um=(view.focus_um,),
        window=view.frame,
        shift_um=view.shift_um,
        few_points=view.few_points,
    )
    if under is not None:
        found = _joined(found, under)
    layers = [c.layer for c in everything]
    shaded = {}
    for each in found:
        if each.shades:
            away_um = each.z_um - view.focus_um
            changes = light_changes(
                layers, each, replace(m, aperture=lamp_aperture),
                area=area_um(m, view.frame, view.shift_um, away_um),
                seen_um=m.blur_diameter_um(away_um) / 2, finer=view.rays,
            )  # fmt: skip
            shaded[each.z_um] = view.face(each, changes)
    return shaded


def _with_images(
    faces: Mapping[float, ShadedFace],
    view: ShadedView,
    layers: Sequence[Layer],
    sampling: Sampling,
) -> dict[float, ShadedFace]:
    """Return faces with images of higher layers where there are mirrors."""
    mirrors = {layer.z_um for layer in layers if layer.finish > 0}
    found = dict(faces)
    if sampling.rays < 1:  # bodies in mirrors are far out of focus as a rule
        sampling = replace(ROUGH, planes=sampling.planes)
    for z_um in mirrors & found.keys():
        images = mirror_images(layers, z_um)
        share = free_of_images(
            images, view.microscope, focus_um=view.focus_um, model=view.model,
            window=view.frame, shift_um=view.shift_um, sampling=sampling,
        )  # fmt: skip
        found[z_um] = replace(found[z_um], images=images, mirrored=share)
    return found


def _background(scene: Scene, faces: Mapping[float, ShadedFace]) -> float | FloatArray:
    """Return what the background sends back, at the pixels if it is shaded."""
    z_um = scene.background_z_um
    if z_um is None or z_um not in faces:
        return scene.background
    return scene.background * faces[z_um].seen


def shade_error(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    lamp_aperture: float,
    window: Window | None = None,
) -> float:
    """Return the largest image error of leaving out the shade.

    Parameters
    ----------
    scene, microscope, focus_um, lamp_aperture, window
        As in `render_coaxial`.

    Returns
    -------
    float
        Share of full scale, two digits, rounded up: the largest difference between
        `render_coaxial` and `render` on some 64 x 64 large pixels, and on the true ones
        about its maximum. 0 where nothing is shaded and no mirror sees less than the
        lens' cone.

    Raises
    ------
    ValueError
        As in `render_coaxial`.
    """
    frame = window or full(microscope)
    every = math.ceil(max(frame.rows, frame.columns) / _PROBES)
    large = replace(
        microscope,
        pitch_um=microscope.pitch_um * every,
        width_px=math.ceil(frame.columns / every),
        height_px=math.ceil(frame.rows / every),
    )
    x, y = pixel_axes_um(microscope, frame, (0.0, 0.0))
    middle = -(x[0] + x[1] * (x[2] - 1) / 2), -(y[0] + y[1] * (y[2] - 1) / 2)

    change = partial(_shading_change, scene, focus_um, lamp_aperture)
    found = change(large, full(large), middle)
    most = float(found.max())
    if every > 1 and most > 0:
        first = int((found >= most * (1 - MARGIN)).argmax())
        row, column = np.unravel_index(first, found.shape)
        near = Window(
            row=frame.row + int((row + 0.5) / large.height_px * frame.rows) - every,
            column=frame.column
            + int((column + 0.5) / large.width_px * frame.columns)
            - every,
            rows=2 * every + 1,
            columns=2 * every + 1,
        )
        most = max(most, float(change(microscope, near, (0.0, 0.0)).max()))
    return rounded_up(most)


def _shading_change(
    scene: Scene,
    focus_um: float,
    lamp_aperture: float,
    setting: Microscope,
    cut: Window,
    shift_um: tuple[float, float],
) -> FloatArray:
    """Return what shade changes at the pixels of a window, (rows, columns)."""
    still = cover(
        scene.layers,
        setting,
        focus_um=focus_um,
        window=cut,
        shift_um=shift_um,
        sampling=ROUGH,
    )
    bare = replace(scene, layers=())
    shaded = render_coaxial(
        bare,
        setting,
        focus_um=focus_um,
        lamp_aperture=lamp_aperture,
        window=cut,
        shift_um=shift_um,
        also=still,
    )
    return np.abs(
        shaded
        - render(
            bare, setting, focus_um=focus_um, window=cut, shift_um=shift_um, also=still
        )
    )


def _heights(scene: Scene, covered: Sequence[Covered]) -> list[float]:
    """Return the heights of what sends light to an image."""
    found = {c.layer.z_um for c in covered if c.layer.reflectance and c.coverage.any()}
    if scene.background_z_um is not None and scene.background:
        found.add(scene.background_z_um)
    return sorted(found)


def _joined(
    found: Sequence[Irradiance], under: Sequence[Irradiance]
) -> tuple[Irradiance, ...]:
    """Return each light found dimmed by that under the other layers too."""
    known = {each.z_um: each for each in under}
    missing = [each.z_um for each in found if each.z_um not in known]
    if missing:
        raise ValueError(f"under must hold heights {missing}, has {sorted(known)}")
    return tuple(each.with_(known[each.z_um]) for each in found)
