"""Images in a ring of light: dull faces that see the ring, edges as bright lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.coaxial_light import area_um, fine_um
from microplan.optics.layers.shaded_view import ShadedFace, ShadedView
from microplan.optics.layers.wall_view import wall_residual
from microplan.optics.light.lamps import RingLamp
from microplan.optics.light.mirrored_strip import MirroredStrip, mirrored_strip
from microplan.optics.light.ring_shadow import ring_irradiance, ring_table
from microplan.optics.outline.offset import offset
from microplan.optics.outline.outline import Outline
from microplan.optics.render.layer_blending import blend_layers, light_up
from microplan.optics.render.render import Covered, cover
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.render.view_range import full
from microplan.optics.transfer.microscope import Microscope

MIDDLE = 0.5  # of where a line may lie, from the drawn edge inwards
_USUAL = Sampling()


def render_ring(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    lamp: RingLamp,
    line: float = MIDDLE,
    model: str = "exact",
    window: Window | None = None,
    light: Illumination | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
    also: Sequence[Covered] = (),
    sampling: Sampling = _USUAL,
) -> FloatArray:
    """Return the noise-free image of a scene under a ring of light.

    Parameters
    ----------
    scene : Scene
        Its layers' reflectance is their dull share; lines are `Layer.edge_line`.
    lamp : RingLamp
        The light.
    line : float
        Where lines lie within the rounding of edges, 0 (at the drawn edge) to 1.
    microscope, focus_um, model, window, light, shift_um, also, sampling
        As in `microplan.optics.render.render.render`.

    Returns
    -------
    (rows, columns) float64 array
        Share of full scale, not clipped: 1 is a white dull face that sees all of the
        ring.

    Raises
    ------
    ValueError
        As in `microplan.optics.render.render.render`, or if a rounding is too large for
        its outline.

    Notes
    -----
    Each face is blurred with the share of the ring on it, as in
    `microplan.optics.layers.shading.render_coaxial`. Lines are added: each is the strip
    of a rounding that mirrors the ring into the lens, as bright as the share of the
    pupil that it fills, and is hidden by the mean coverage of what is higher.
    """
    frame = window or full(microscope)
    covered = partial(
        cover,
        microscope=microscope,
        focus_um=focus_um,
        model=model,
        window=frame,
        shift_um=shift_um,
        sampling=sampling,
    )
    everything = (*also, *covered(scene.layers))
    view = ShadedView(
        microscope=microscope,
        focus_um=focus_um,
        model=model,
        frame=frame,
        shift_um=shift_um,
        # points are as close as edges in focus ask for: rays alone are fewer
        rays=min(sampling.rays, 1.0) ** 0.5,
        walls=sampling.walls or 1.0,
    )
    faces = _lit(scene, view, everything, lamp)
    patches = [
        c.patch(view.lit(c, faces[c.layer.z_um]) if c.layer.z_um in faces else None)
        for c in everything
    ]
    image = np.empty((frame.rows, frame.columns))
    z_um = scene.background_z_um
    below = faces.get(z_um) if z_um is not None else None
    blend_layers(
        image, patches, scene.background * (1.0 if below is None else below.seen)
    )
    far_light = partial(ring_table, [c.layer for c in everything], lamp=lamp)
    if sampling.rays > 0:
        for change in (
            view.residual(scene, everything, faces),
            wall_residual(view, scene, everything, faces, far_light, is_fine=True),
        ):
            if change is not None:
                image += change
    strip = mirrored_strip(lamp, microscope.aperture / microscope.medium_index)
    image += _lines(everything, faces, (line, strip), covered)
    light_up(image, microscope, frame, light or Illumination())
    return image


def _lit(
    scene: Scene, view: ShadedView, everything: Sequence[Covered], lamp: RingLamp
) -> dict[float, ShadedFace]:
    """Return the faces that bodies keep some of the ring from, by height."""
    m = view.microscope
    layers = [c.layer for c in everything]
    heights = {c.layer.z_um for c in everything if c.coverage.any()}
    if scene.background_z_um is not None and scene.background:
        heights.add(scene.background_z_um)
    found = {}
    for z_um in sorted(heights):
        area = area_um(m, view.frame, view.shift_um, z_um - view.focus_um)
        seen_um = m.blur_diameter_um(z_um - view.focus_um) / 16
        light = ring_irradiance(layers, z_um, lamp, area, max(fine_um(m), seen_um))
        if light.shades:
            found[z_um] = view.face(light, ())
    return found


def _lines(
    everything: Sequence[Covered],
    faces: Mapping[float, ShadedFace],
    line: tuple[float, MirroredStrip],
    covered: Callable[[Sequence[Layer]], tuple[Covered, ...]],
) -> FloatArray:
    """Return the light of all lines at the pixels, (rows, columns)."""
    total = np.zeros(everything[0].coverage.shape) if everything else np.zeros((1, 1))
    for each in everything:
        layer = each.layer
        band = line_layer(layer, *line)
        if band is None or layer.edge_line is None or not each.coverage.any():
            continue
        (seen,) = covered([band])
        light = layer.edge_line.level * line[1].share * seen.coverage
        if layer.z_um in faces:
            light = light * faces[layer.z_um].seen
        for other in everything:
            if other.layer.z_um > layer.z_um:
                light = light * (1 - other.coverage)
        total += light
    return total


def line_layer(layer: Layer, line: float, strip: MirroredStrip) -> Layer | None:
    """Return the bands of a face that a line takes up, None if it has no line.

    `line` is 0 where it begins at the drawn edge and 1 where it ends a radius inside.
    Where bands of the strip lie over each other, they cover as many times.
    """
    edge = layer.edge_line
    if edge is None or edge.level == 0:
        return None
    by = line * (1 - strip.width) - min(strip.outer)
    rounded = Outline(rings=layer.outline.rings[: edge.rings])
    bands = [
        _band(rounded, (outer + by) * edge.radius_um, (inner + by) * edge.radius_um)
        for outer, inner in zip(strip.outer, strip.inner, strict=True)
    ]
    rings = tuple(ring for band in bands for ring in band.rings)
    return replace(
        layer, outline=Outline(rings=rings), edge_line=None, underside_um=None
    )


@lru_cache(maxsize=64)
def _band(outline: Outline, outer_um: float, inner_um: float) -> Outline:
    """Return what lies between two distances inside an outline's edges."""
    outside, inside = offset(outline, -outer_um), offset(outline, -inner_um)
    return Outline(rings=(*outside.rings, *(ring.reversed() for ring in inside.rings)))
