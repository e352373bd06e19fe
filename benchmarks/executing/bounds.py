"""What one frame of a look can tell at most."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from microplan.featuresel.limits.crlb import place_limits_um
from microplan.featuresel.look.scenario import LookCase

_DRAWS = 400_000  # tell a quantile of .95 to .1 %


def limit_p95_um(case: LookCase, share: float) -> float:
    """Return the quantile of the distance that errors at the Cramer-Rao limit have.

    The zoom's scale is known here: about the axis it moves what is far from there.
    """
    known = replace(case, spread=replace(case.spread, magnification_sigma=0.0))
    sigmas = np.array(place_limits_um(known))
    errors = np.random.default_rng(0).standard_normal((_DRAWS, 2)) * sigmas
    return float(np.quantile(np.hypot(*errors.T), share))
