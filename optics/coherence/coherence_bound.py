"""What the incoherent image of a scene errs by where the light is partly coherent."""

from __future__ import annotations

import math

from microplan.optics.coherence.edge_offsets import amplitude_contrast, coherence_error
from microplan.optics.outline.outline import Outline, Ring
from microplan.optics.render.scene import Scene
from microplan.optics.transfer.microscope import Microscope

# Errors of whole bodies over that of a straight edge, rounded up from the worst that
# `benchmarks.optics.coherence` measures on gear, bore, pins and finger: corners and
# edges a few wavelengths over A apart add up, and defocus gathers light behind narrow
# bodies.
CLOSE_EDGES = 2.1
NARROW_EDGES = 5.0
_NARROW = 2.0  # mean width over the radius of the first Fresnel zone


def scene_error(
    scene: Scene, microscope: Microscope, *, focus_um: float, coherence: float
) -> float:
    """Return what `microplan.optics.render.render.render` errs by, of full scale.

    Parameters
    ----------
    scene : Scene
        What is rendered.
    microscope : Microscope
        The optical setting.
    focus_um : float
        World height of the plane in focus.
    coherence : float
        Aperture of the condenser over that of the objective; 0 stands for incoherent
        light, as in a workcell.

    Returns
    -------
    float
        Bound of the difference from
        `microplan.optics.coherence.coherence.render_coherent`: the largest step of
        reflectance times the error of a straight edge times `CLOSE_EDGES`, or
        `NARROW_EDGES` where the mean width of a body or hole is below two Fresnel
        radii, added up over the layers' heights. What `render_coherent` itself errs by,
        `microplan.optics.coherence.source.source_error`, comes on top. Measured on
        single bodies with some tens of edges; many that lie in a regular pattern may
        interfere more.

    Raises
    ------
    ValueError
        As `microplan.optics.coherence.edge_offsets.coherence_error`: also if a layer is
        farther out of focus than `microplan.optics.coherence.edge_offsets.EDGE_WAVES`.
    """
    layers = [layer for layer in scene.layers if layer.outline.rings]
    levels = [scene.background, *(layer.reflectance for layer in layers)]
    step = max(levels) - min(levels)
    if step == 0:
        return 0.0
    contrast = amplitude_contrast(max(levels), min(levels))
    worst: dict[float, float] = {}
    for layer in layers:
        defocus_um = layer.z_um - focus_um
        edge = coherence_error(coherence, microscope, contrast, defocus_um)
        fresnel_um = math.sqrt(microscope.wavelength_um * abs(defocus_um))
        narrow = mean_width_um(layer.outline) < _NARROW * fresnel_um
        error = edge * (NARROW_EDGES if narrow else CLOSE_EDGES)
        worst[layer.z_um] = max(error, worst.get(layer.z_um, 0.0))
    return step * sum(worst.values())


def mean_width_um(outline: Outline) -> float:
    """Return twice area over perimeter, the least of the body and of its rings, um.

    The radius of a disc, nearly the width of a strip or of an annulus.
    """
    body = 2 * outline.area_um2 / outline.perimeter_um
    return min([body, *(_ring_width_um(ring) for ring in outline.rings)])


def _ring_width_um(ring: Ring) -> float:
    length = sum(edge.length_um for edge in ring.edges)
    return 2 * abs(ring.signed_area_um2) / length
