"""Edge offsets in partially coherent light, from a table."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from microplan.arrays import FloatArray, Point
from microplan.optics.coherence.edge_table import COHERENCE, CONTRAST, EDGES, WAVES
from microplan.optics.outline.clip import to_edges
from microplan.optics.outline.outline import Outline, Ring
from microplan.optics.render.scene import Scene
from microplan.optics.render.spectrum import boundary_nodes
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
    focus_um : float
        World height of the plane in focus.
    coherence : float
        Aperture of the condenser over that of the objective; 0 means incoherent
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
        interfere more. Through a perfect lens without a halo: a wavefront error is in
        neither image.

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


EDGE_WAVES = WAVES[-1]  # |W20| up to which edges are predicted


def amplitude_contrast(one: float, other: float) -> float:
    """Return 1 - dark / bright of the amplitudes of two reflectances, 0..1.

    Raises
    ------
    ValueError
        If a reflectance is negative or not finite, or both are 0.
    """
    dark, bright = sorted((one, other))
    if not (dark >= 0 and bright > 0 and math.isfinite(bright)):
        raise ValueError(f"reflectances must be >= 0 and not both 0: {one}, {other}")
    return 1 - math.sqrt(dark / bright)


def edge_offset_um(
    coherence: float, microscope: Microscope, contrast: float, defocus_um: float = 0.0
) -> float:
    """Return how far the 50 % point of an edge lies from where the edge is, um.

    Parameters
    ----------
    coherence : float
        Aperture of the condenser over that of the objective; 0 means incoherent
        light, as in a workcell, whose edges stay.
    contrast : float
        Of the amplitudes, see `amplitude_contrast`; 0..1.
    defocus_um : float
        Height of the edge minus that of the plane in focus, either sign.

    Returns
    -------
    float
        Into the bright side, >= 0. From a table of straight edges between equal phases
        with a quadratic defocus phase, rim-matched, read by piecewise cubics; above its
        last coherence the offset falls as 1 / coherence. Between its entries it errs by
        up to .006 wavelength / A within one wave of defocus and by .04 beyond, both
        measured by `benchmarks.optics.coherence`. The pixel's width is left out, and so
        is the lens' wavefront error: see
        `microplan.optics.coherence.aberrated_edges.aberrated_offsets_um`.

    Raises
    ------
    ValueError
        If `coherence` is negative, `contrast` outside 0..1, a number not finite, or
        the defocus beyond `EDGE_WAVES`, where fringes make 50 % arbitrary.
    """
    waves = _checked(coherence, microscope, contrast, defocus_um)
    if coherence == 0:
        return 0.0
    held = min(coherence, COHERENCE[-1])
    per_contrast = float(_OFFSET((held, waves, contrast)))
    airy = microscope.wavelength_um / microscope.aperture
    return per_contrast * contrast * held / coherence * airy


def coherence_error(
    coherence: float,
    microscope: Microscope,
    contrast: float = 1.0,
    defocus_um: float = 0.0,
) -> float:
    """Return what the incoherent image of a straight edge errs by, of the step.

    Arguments and errors as in `edge_offset_um`. The largest of the table's entries
    around coherence and defocus. A step's image is a blend of a weak edge's and of
    one over black, the latter's share c / (2 - c) at a contrast c; so the largest error
    is convex over that share, and read linearly it is not too small. Edges closer than
    a few wavelengths over A, and corners, add up: see
    `microplan.optics.coherence.edge_offsets`.
    """
    waves = _checked(coherence, microscope, contrast, defocus_um)
    if coherence == 0:
        return 0.0
    held = min(coherence, COHERENCE[-1])
    around = _ERROR[_around(COHERENCE, held), _around(WAVES, waves)].max(axis=(0, 1))
    share = contrast / (2 - contrast)
    return float(np.interp(share, _SHARE, around)) * held / coherence


def ring_shifts_um(
    outline: Outline,
    coherence: float,
    microscope: Microscope,
    *,
    reflectance: float,
    background: float,
) -> tuple[Point, ...]:
    """Return how the rings of a body in focus seem to move, to first order, um.

    Parameters
    ----------
    coherence, microscope
        As in `edge_offset_um`.
    reflectance, background : float
        Of the body and of what lies around it; the brighter one shrinks.

    Returns
    -------
    tuple of (x, y)
        The shift of each ring's enclosed area's centroid. Centroids of rings with a
        centre of symmetry stay. Straight edges are assumed: radii and distances must be
        well above wavelength / A.

    Raises
    ------
    ValueError
        As `edge_offset_um`, or if a reflectance is negative or not finite.
    """
    grown = 0.0
    if reflectance != background:
        contrast = amplitude_contrast(reflectance, background)
        moved = edge_offset_um(coherence, microscope, contrast)
        grown = -moved if reflectance > background else moved
    return tuple(_shift_um(ring, grown) for ring in outline.rings)


def _shift_um(ring: Ring, grown_um: float) -> Point:
    """Return how a body grown by a distance shifts the centroid within one ring."""
    area = ring.signed_area_um2
    outwards = grown_um if area > 0 else -grown_um  # from the enclosed area
    x, y, dx, dy = boundary_nodes(to_edges(Outline(rings=(ring,))), 0.0)
    length = np.hypot(dx, dy)
    cx = float(x**2 @ dy) / (2 * area)
    cy = -float(y**2 @ dx) / (2 * area)
    share = outwards / abs(area)
    return share * float((x - cx) @ length), share * float((y - cy) @ length)


def _checked(
    coherence: float, microscope: Microscope, contrast: float, defocus_um: float
) -> float:
    """Refuse what the table does not hold; return |W20| in waves."""
    if not (coherence >= 0 and math.isfinite(coherence)):
        raise ValueError(f"coherence must be finite and >= 0, got {coherence}")
    if not 0 <= contrast <= 1:
        raise ValueError(f"contrast must be in 0..1, got {contrast}")
    waves = abs(microscope.rim_w20_um(defocus_um)) / microscope.wavelength_um
    if not waves <= EDGE_WAVES:  # also refuses nan
        raise ValueError(
            f"defocus_um must stay within {EDGE_WAVES} waves, got {defocus_um} um, "
            f"{waves:.3g} waves"
        )
    return waves


def _around(axis: tuple[float, ...], value: float) -> slice:
    """Return the one or two indices of `axis` at or about a value."""
    below = int(np.searchsorted(axis, value, side="right")) - 1
    return slice(below, below + (1 if axis[below] == value else 2))


_SHAPE = (len(COHERENCE), len(WAVES), 2, len(CONTRAST))
_TABLE: FloatArray = np.array(EDGES).reshape(_SHAPE)
_ERROR: FloatArray = _TABLE[:, :, 1]
_SHARE: FloatArray = np.array(CONTRAST) / (2 - np.array(CONTRAST))  # of the full edge
# monotone between entries, so that the bend at a coherence of 1 does not overshoot
_OFFSET = RegularGridInterpolator(
    (COHERENCE, WAVES, CONTRAST), _TABLE[:, :, 0], method="pchip"
)
