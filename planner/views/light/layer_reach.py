"""Layers that an image needs: those in view, and those that shade what is."""

from __future__ import annotations

import math

from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope


def relevant(
    layers: tuple[Layer, ...], microscope: Microscope, focus_um: float, window: Window
) -> tuple[Layer, ...]:
    """Return the layers whose blurred image reaches the window."""
    return tuple(
        layer
        for layer in layers
        if meets(layer, seen_um(layer, microscope, focus_um), microscope, window)
    )


def lit(
    scene: Scene,
    microscope: Microscope,
    focus_um: float,
    window: Window,
    lamp_slope: float,
) -> tuple[Layer, ...]:
    """Return the layers whose blurred image, or whose shade, reaches the window.

    `lamp_slope`: how far aside the lamp's steepest rays go a um of height.
    """
    heights = [layer.z_um for layer in scene.layers]
    if scene.background_z_um is not None:
        heights.append(scene.background_z_um)
    low_um = min(heights, default=focus_um)
    aside_um = abs(low_um - focus_um) * marginal_slope(microscope)
    return tuple(
        layer
        for layer in scene.layers
        if meets(
            layer,
            max(
                seen_um(layer, microscope, focus_um),
                aside_um + (layer.z_um - low_um) * lamp_slope,
            ),
            microscope,
            window,
        )
    )


def seen_um(layer: Layer, microscope: Microscope, focus_um: float) -> float:
    """Return how far beyond a layer's outline its blurred image reaches."""
    # 20 Airy units beyond the geometrical blur hold all but 1 % of the diffracted light
    ends = (
        layer.z_um,
        layer.z_um if layer.underside_um is None else layer.underside_um,
    )
    blur_um = max(abs(z_um - focus_um) for z_um in ends) * marginal_slope(microscope)
    tail_um = 20 * microscope.wavelength_um / microscope.aperture
    return blur_um + max(tail_um, microscope.halo_reach_um)


def marginal_slope(microscope: Microscope) -> float:
    """Return how far aside the marginal ray goes a um of height."""
    return math.tan(math.asin(microscope.aperture / microscope.medium_index))


def meets(layer: Layer, reach: float, microscope: Microscope, window: Window) -> bool:
    """Return whether a layer's bounds and so many um beyond meet the window."""
    x0, y0, x1, y1 = layer.outline.bounds_um
    k = microscope.px_per_um
    cx, cy = (microscope.width_px - 1) / 2, (microscope.height_px - 1) / 2
    left, right = cx + k * (x0 - reach), cx + k * (x1 + reach)
    top, bottom = cy - k * (y1 + reach), cy - k * (y0 - reach)
    # a pixel reaches half a pixel to all sides of its centre, a whole number
    first_column, first_row = window.column - 0.5, window.row - 0.5
    return (
        right >= first_column
        and left <= first_column + window.columns
        and bottom >= first_row
        and top <= first_row + window.rows
    )
