"""Closed forms of a round bore: aperture and brightness on its axis."""

from __future__ import annotations

import math
from dataclasses import replace

from microplan.optics.transfer.microscope import Microscope


def bore_aperture(radius_um: float, depth_um: float, microscope: Microscope) -> float:
    """Return the aperture left on the axis: min(A, n sin atan(R / h))."""
    sine = radius_um / math.hypot(radius_um, depth_um)
    return min(microscope.aperture, microscope.medium_index * sine)


def bore_brightness(
    radius_um: float,
    depth_um: float,
    microscope: Microscope,
    *,
    lamp_aperture: float | None = None,
) -> float:
    """Return the relative brightness on the axis, 1 without the bore.

    (a / A)**2, times (a / A_lamp)**2 for light through the objective, with a the
    smaller of the aperture left and the pupil's. The sine form is exact: the pupil is
    filled evenly by area, and its radius is the sine.
    """
    seen = bore_aperture(radius_um, depth_um, microscope) / microscope.aperture
    if lamp_aperture is None:
        return seen**2
    lamp = replace(microscope, aperture=lamp_aperture)
    return (seen * bore_aperture(radius_um, depth_um, lamp) / lamp_aperture) ** 2
