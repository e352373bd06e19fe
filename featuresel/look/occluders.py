"""Occluders of a target, as planned or displaced, each owner for itself."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from microplan.featuresel.look.perturb import turned
from microplan.featuresel.look.scenario import Backdrop, LookCase, render_look
from microplan.featuresel.look.static_layers import CUT, standing
from microplan.featuresel.routines.contract import Occluders
from microplan.optics.outline.outline import Outline, Ring, Segment, place
from microplan.optics.render.scene import Illumination, Layer
from microplan.optics.render.view_range import Range

_TURNS = 12  # of the circle, where an angle is unknown: blur leaves its first waves


def displaced_look(case: LookCase) -> Iterator[tuple[LookCase, float]]:
    """Yield the look with the static scene displaced, and the root of its weight."""
    own = case.target.name.partition(".")[0]
    names = sorted({layer.name.partition(".")[0] for layer in case.static} - {own})
    sigma = case.spread.occluder_sigma_um
    for name in names if sigma > 0 else ():
        for x, y in ((sigma, 0.0), (-sigma, 0.0), (0.0, sigma), (0.0, -sigma)):
            moved = _moved(case.static, name, x, y)
            yield replace(case, static=moved), math.sqrt(1 / 2)
    for what in case.spread.turning:
        turns = [what.sigma_theta_rad, -what.sigma_theta_rad]
        if what.is_any:
            turns = [2 * math.pi * k / _TURNS for k in range(1, _TURNS)]
        for turn in turns:
            weight = 1 / (_TURNS if what.is_any else 2)
            there = turned(case.static, what, turn)
            yield replace(case, static=there), math.sqrt(weight)


def _moved(
    layers: tuple[Layer, ...], owner: str, x_um: float, y_um: float
) -> tuple[Layer, ...]:
    """Return layers with those of one owner moved."""
    return tuple(
        replace(layer, outline=place(layer.outline, x_um, y_um, 0.0))
        if layer.name.partition(".")[0] == owner
        else layer
        for layer in layers
    )


_OCCLUDED = 3.0  # fields: the face behind the occluder ends out of sight


def occluders(case: LookCase, dz_um: float) -> Occluders:
    """Return the target's occluders, `dz_um` off nominal focus.

    A face without end at the height of the target's top, once black and once white,
    takes the target's place; what lies below it is not seen.
    """
    top_um = max(layer.z_um for layer in case.moving)
    # what lies below the face is hidden, and need not be rendered
    above = tuple(layer for layer in case.static if layer.z_um > top_um)
    if not above:
        shape = (case.window.rows, case.window.columns)
        return Occluders(light=np.zeros(shape), through=np.ones(shape))
    even = replace(case, light=Illumination(), static=above, background_z_um=None)
    shown = _before(even, _face(even, top_um, 0.0), dz_um)
    even = replace(even, focus_um=case.focus_um + dz_um)
    black, white = (
        render_look(even, (_face(even, top_um, reflectance),), shown)
        for reflectance in (0.0, 1.0)
    )
    return Occluders(light=case.light.gain * black, through=white - black)


def _before(case: LookCase, face: Layer, dz_um: float) -> Backdrop:
    """Return the occluder of a face, `dz_um` off nominal focus.

    Heights within one of equal steps share the transforms.
    """
    wide_um = max(2 * CUT * case.spread.focus_sigma_um, case.microscope.wave_depth_um)
    middle_um = case.focus_um + round(dz_um / wide_um) * wide_um
    half_um = wide_um / 2 * (1 + 1e-9)  # ends belong to both
    reach = Range(focus_um=(middle_um - half_um, middle_um + half_um))
    ready = standing(replace(case, moving=(face,)), case.static, reach, case.model)
    return Backdrop() if ready is None else ready.at(focus_um=case.focus_um + dz_um)


def _face(case: LookCase, z_um: float, reflectance: float) -> Layer:
    """Return a face without end."""
    side = _OCCLUDED * max(case.microscope.field_um)
    corners = [(-side, -side), (side, -side), (side, side), (-side, side)]
    edges = tuple(
        Segment(start=a, end=b)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    )
    return Layer(
        name="face",
        outline=Outline(rings=(Ring(edges=edges),)),
        z_um=z_um,
        reflectance=reflectance,
    )
