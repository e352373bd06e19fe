"""The Cramer-Rao limit of a look's place: what no estimator of it can go below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microplan.featuresel.limits.crlb import camera_of, fisher
from microplan.featuresel.limits.information import limit
from microplan.featuresel.look.nominal import swayed
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.sensitivity import Sensitivities, sensitivities
from microplan.featuresel.routines.likelihood.occluder_modes import principal

_SWAY = "sway_"  # begins the names of what lies elsewhere


def limit_um(case: LookCase) -> float | None:
    """Return the Cramer-Rao limit of a look's place, the worse axis, as planned.

    What the trials vary is unknown to the estimator too: angle, focus, zoom, light, and
    within its spread where what stands above the target is, and how it is turned.
    """
    worse = max(place_limits_um(case))
    return worse if worse < float("inf") else None


def place_limits_um(case: LookCase) -> tuple[float, float]:
    """Return the Cramer-Rao limits of a look's place in x and y, see `limit_um`."""
    seen = _with_sways(case, sensitivities(case, names=unknowns(case)))
    occluder_modes = [name for name in seen.names if name.startswith(_SWAY)]
    told = fisher(seen, camera_of(case)).with_prior(dict.fromkeys(occluder_modes, 1.0))
    known = limit(told)
    return known["x"], known["y"]


def unknowns(case: LookCase) -> Sequence[str]:
    """Return what an estimator must find besides the place, by the limit's names."""
    spread, names = case.spread, ["x", "y"]
    if case.target.kind != "circle":
        names.append("theta")
    if spread.focus_sigma_um > 0:
        names.append("z")
    if spread.magnification_sigma > 0:
        names.append("zoom")
    names.append("gain")
    if spread.light_gradient[1] > 0:
        names += ["gradient_x", "gradient_y"]
    return names


def _with_sways(case: LookCase, seen: Sensitivities) -> Sensitivities:
    """Return slopes by what stands above too, each over one standard deviation."""
    changes = case.sensor.gain * swayed(case)
    if len(changes) == 0:
        return seen
    noise = np.sqrt(camera_of(case).variance(seen.mean))
    occluder_modes = np.tensordot(principal(changes / noise), changes, 1)
    return replace(
        seen,
        names=(*seen.names, *(f"{_SWAY}{k}" for k in range(len(occluder_modes)))),
        slopes=np.concatenate((seen.slopes, occluder_modes)),
        errors=np.concatenate((seen.errors, np.zeros_like(occluder_modes))),
    )
