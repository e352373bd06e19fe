"""The numbers of docs/limits.md: python -m benchmarks.localisation.limits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

from benchmarks.localisation.depth_of_field import depth_of_field, limit_curve, prices
from benchmarks.localisation.information import (
    informative,
    slopes_of,
    together,
    without,
)
from microplan.featuresel.limits.crlb import camera_of, fisher
from microplan.featuresel.limits.information import limit
from microplan.featuresel.limits.resolution import contrast, spurious_um
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.sensitivity import (
    LIGHT,
    POSE,
    LookSetting,
    Sensitivities,
    sensitivities,
)
from microplan.optics.render.scene import Window
from tests.featuresel.conftest import find_gear, post_alone

HEIGHTS = (0.0, 0.3, 10.0, 25.0, 50.0)
UNKNOWN = (*POSE, "gain", "offset")
TOLERANCES = {"x": 4e-3, "theta": math.radians(0.01)}


def gear() -> LookCase:
    """Return the page's gear, a fraction of a pixel off the grid."""
    case = find_gear()
    scope = replace(case.microscope, pitch_um=7.4)
    return replace(case, microscope=scope, x_um=0.31, y_um=-0.17)


@cache
def slopes(z_um: float) -> Sensitivities:
    """Return the gear's slopes at a focus."""
    return sensitivities(gear(), LookSetting(dz_um=z_um), POSE + LIGHT)


def row(z_um: float) -> tuple[float, ...]:
    """Return x px, x nm, theta mdeg, z nm, zoom 1e-5, pixels %: a row of the table."""
    case = gear()
    camera, seen = camera_of(case), slopes(z_um)
    sigma = limit(fisher(slopes_of(seen, UNKNOWN), camera))
    chosen = informative(
        slopes_of(seen, ("x", "y", "theta", "gain")), camera, POSE[:3], share=0.95
    )
    return (
        sigma["x"] * case.microscope.px_per_um,
        sigma["x"] * 1e3,
        math.degrees(sigma["theta"]) * 1e3,
        sigma["z"] * 1e3,
        sigma["zoom"] * 1e5,
        100 * float(chosen.mean()),
    )


def pair_nm() -> float:
    """Return the limit of z from images at -10 and 10 um, each with its own light."""
    camera = camera_of(gear())
    below, above = (fisher(slopes(z), camera) for z in (-10.0, 10.0))
    own = together(without(below, LIGHT), without(above, LIGHT))
    return 1e3 * limit(own)["z"]


def light_prices(side_px: int) -> dict[str, float]:
    """Return what light terms cost at 25 um, zoom and gain being unknown anyway."""
    first = (320 - side_px // 2, 240 - side_px // 2)
    window = Window(row=first[1], column=first[0], rows=side_px, columns=side_px)
    case = replace(gear(), window=window)
    seen = sensitivities(case, LookSetting(dz_um=25.0), POSE + LIGHT)
    told = fisher(seen, camera_of(case))
    return prices(told, POSE[:4], free=("zoom", "gain"), extra=LIGHT[1:])


def _lines() -> Iterator[str]:
    for z_um in HEIGHTS:
        yield f"z {z_um}: " + ", ".join(f"{value:.3g}" for value in row(z_um))
    yield f"z from a pair: {pair_nm():.2f} nm"
    for side in (200, 116):
        yield f"prices at 25 um in {side} px: {light_prices(side)}"
    for law in ("exact", "hopkins"):
        yield f"spurious, {law}: {spurious_um(replace(gear(), model=law)):.2f} um"
    for name, case in (("gear", gear()), ("post", post_alone())):
        yield f"contrast of the {name} at 5, 10 um: {contrast(case, (5.0, 10.0))}"
    for name, tolerance in TOLERANCES.items():
        curve = limit_curve(gear(), name, ("x", "y", "theta", "gain"))
        yield f"{name}: {depth_of_field(gear(), curve, tolerance, reach_um=60.0)}"


if __name__ == "__main__":
    for line in _lines():
        print(line, flush=True)
