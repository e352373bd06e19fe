"""Looks at one feature of a part, about the feature's own reference point."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

from microplan.featuresel.features.contour import with_contour
from microplan.featuresel.features.feature import Feature
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Target
from microplan.optics.outline.outline import Outline, place


def target_of(
    feature: Feature,
    outline: Outline,
    *,
    column: float,
    row: float,
    theta_rad: float,
    px_per_um: float,
    search_px: float = 1.0,
    theta_range_rad: float = 0.0,
) -> Target:
    """Return the feature as what routines look for; `theta_rad` is the part's."""
    x, y = feature.center_um
    about = place(place(outline, -x, -y), 0.0, 0.0, -feature.angle_rad)
    target = Target(
        name=feature.name,
        kind=feature.kind,
        column=column,
        row=row,
        theta_rad=theta_rad + feature.angle_rad,
        px_per_um=px_per_um,
        search_px=search_px,
        theta_range_rad=theta_range_rad,
        symmetry=feature.symmetry,
        bright=feature.bright,
        parameters=feature.parameters,
    )
    return with_contour(target, [about])


def aimed(case: LookCase, feature: Feature, theta_range_rad: float) -> LookCase:
    """Return the look with one feature of its part as the target, in its place."""
    x, y = feature.center_um
    swung = cmath.rect(1.0, case.theta_rad) * complex(x, y)
    x_um, y_um = case.x_um + swung.real, case.y_um + swung.imag
    column, row = case.frame.to_pixel(x_um, y_um)
    target = target_of(
        feature,
        case.moving[0].outline,
        column=column,
        row=row,
        theta_rad=case.theta_rad,
        px_per_um=case.microscope.px_per_um,
        search_px=case.microscope.px_per_um * case.spread.search_um,
        theta_range_rad=theta_range_rad,
    )
    return replace(
        case,
        key=f"{case.key}/{feature.name}",
        moving=tuple(
            replace(layer, outline=place(layer.outline, -x, -y))
            for layer in case.moving
        ),
        x_um=x_um,
        y_um=y_um,
        target=target,
        theta_any=theta_range_rad == math.pi,
    )
