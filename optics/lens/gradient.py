"""Shifts of edges and centroids in an image by a gradient of the light."""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.outline.clip import to_edges
from microplan.optics.outline.outline import Outline
from microplan.optics.render.spectrum import boundary_nodes
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.otf import hopkins

_GAUSS = np.polynomial.legendre.leggauss(512)  # over the band: tests say how good
_DENSITY_PER_UM = 0.1  # of boundary nodes: exact for segments, 1e-8 for arcs


def slope_per_um(microscope: Microscope, defocus_um: float) -> float:
    """Return how steep the image of a straight edge is at the edge, per um.

    Parameters
    ----------
    defocus_um : float
        Height of the edge minus that of the plane in focus.

    Returns
    -------
    float
        Of unit contrast: the integral of transfer times pixel over all frequencies
        across the edge, which runs along rows or columns; model `hopkins`.
    """
    slope, _ = _edge(microscope, defocus_um, 0.0)
    return slope


def steepest_shift_um(
    gradient_per_um: float,
    microscope: Microscope,
    defocus_um: float,
    *,
    smoothing_um: float = 0.0,
) -> float:
    """Return how far a gradient moves the steepest point of an edge, um.

    Parameters
    ----------
    gradient_per_um : float
        Relative change of the light across the edge, per um.
    microscope, defocus_um
        As in `slope_per_um`.
    smoothing_um : float
        Standard deviation of a Gaussian that the image is smoothed with before, as an
        edge finder does.

    Returns
    -------
    float
        Up the gradient, whichever side is bright: g (2 v - s**2), where v is the slope
        over minus its second derivative at the edge of the smoothed image, a variance
        (v = s**2 + b**2 for a Gaussian blur b). To first order in g sqrt(v). The
        reflectances do not matter.

    Raises
    ------
    ValueError
        If the edge is not steepest at the edge: far out of focus, smoothed too little.
    """
    slope, bend = _edge(microscope, defocus_um, smoothing_um)
    if not (slope > 0 and bend > 0):
        raise ValueError(
            f"an edge {defocus_um} um out of focus and smoothed over {smoothing_um} um "
            "is not steepest in its middle"
        )
    return gradient_per_um * (2 * slope / bend - smoothing_um**2)


def threshold_shift_um(
    gradient_per_um: float,
    slope: float,
    levels: tuple[float, float],
    *,
    lever_um: float,
) -> float:
    """Return how far a gradient moves an edge's crossing of a threshold, um.

    Parameters
    ----------
    gradient_per_um : float
        Relative change of the light where the threshold is half-way
        between the levels of both sides.
    slope : float
        Of the edge, of unit contrast per um: `slope_per_um`.
    levels : (dark, bright)
        Reflectances on both sides.
    lever_um : float
        How far up the gradient from that point the edge is.

    Returns
    -------
    float
        Towards the dark side: g lever (d + b) / (2 (b - d) slope). To first order in
        g lever. Opposite edges of a body lit evenly about its middle move in the same
        direction.

    Raises
    ------
    ValueError
        If the levels are no (dark, bright) or the slope is not positive.
    """
    dark, bright = levels
    if not (slope > 0 and bright > dark >= 0):
        raise ValueError(
            f"an edge needs a slope and two levels, got {slope} and {levels}"
        )
    return gradient_per_um * lever_um * (dark + bright) / (2 * (bright - dark) * slope)


def _edge(
    microscope: Microscope, defocus_um: float, smoothing_um: float
) -> tuple[float, float]:
    """Return slope and minus its second derivative at an edge, per um and per um3."""
    if not (math.isfinite(smoothing_um) and smoothing_um >= 0):
        raise ValueError(f"smoothing_um must be finite and >= 0, got {smoothing_um}")
    waves = microscope.rim_w20_um(defocus_um) / microscope.wavelength_um
    node, weight = _GAUSS
    x = (1 + node) / 2
    f = x * microscope.cutoff_per_um
    pixel = np.sinc(f * microscope.um_per_px * math.sqrt(microscope.fill_factor))
    smooth = np.exp(-2 * (np.pi * f * smoothing_um) ** 2)
    # halved weights for x in 0..1, doubled for both signs of the frequency
    terms = weight * hopkins(x, waves) * pixel * smooth * microscope.cutoff_per_um
    return float(terms.sum()), float((terms * (2 * np.pi * f) ** 2).sum())


def relative_gradient(
    microscope: Microscope, gradient: tuple[float, float], at_um: tuple[float, float]
) -> tuple[float, float]:
    """Return the relative change of the light per um at a point, along x and y.

    Parameters
    ----------
    microscope : Microscope
        The optical setting, whose field the gradients refer to.
    gradient : (x, y)
        As in `microplan.optics.render.scene.Illumination`.
    at_um : (x, y)
        The point, from the optical axis.

    Raises
    ------
    ValueError
        If the light is not positive there.
    """
    gx, gy = (g / f for g, f in zip(gradient, microscope.field_um, strict=True))
    level = 1 + gx * at_um[0] + gy * at_um[1]
    if not level > 0:
        raise ValueError(f"the light is {level} at {at_um}, it must be positive")
    return (gx / level, gy / level)


def centroid_shift_um(
    outline: Outline, gradient: tuple[float, float], microscope: Microscope
) -> tuple[float, float]:
    """Return how far a gradient moves the centroid of the light of a body, um.

    ValueError if the outline has no area, or the light is not positive at its centroid.

    Parameters
    ----------
    outline : Outline
        A body over a black ground, um.
    gradient : (x, y)
        As in `microplan.optics.render.scene.Illumination`.
    microscope : Microscope
        The optical setting, whose field the gradients refer to.

    Returns
    -------
    (x, y)
        M g, with M the second central moments over the area and g the relative change
        of the light per um at the centroid. Exact for a sharp image; blur adds its own
        second moment to M.
    """
    area, (x, y), second = moments(outline)
    g = np.array(relative_gradient(microscope, gradient, (x, y)))
    shift = second / area @ g
    return (float(shift[0]), float(shift[1]))


def moments(outline: Outline) -> tuple[float, tuple[float, float], FloatArray]:
    """Return the area, the centroid and the second central moments (2, 2) of a body.

    um2, um and um4, by boundary integrals.

    Raises
    ------
    ValueError
        If the outline has no area.
    """
    x, y, dx, dy = boundary_nodes(to_edges(outline), _DENSITY_PER_UM)
    middle_x, middle_y = (x.min() + x.max()) / 2, (y.min() + y.max()) / 2
    x, y = x - middle_x, y - middle_y  # less to cancel
    area = float(x @ dy)
    if not area > 0:
        raise ValueError(f"the outline has no area: {area} um2")
    u, v = float(x**2 @ dy) / 2 / area, -float(y**2 @ dx) / 2 / area
    xx, yy = float(x**3 @ dy) / 3, -float(y**3 @ dx) / 3
    xy = float((x**2 * y) @ dy) / 2
    second = np.array([[xx, xy], [xy, yy]]) - area * np.outer((u, v), (u, v))
    return area, (float(u + middle_x), float(v + middle_y)), second
