"""What one frame of a look can tell at most, and what a mean of frames tells."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from microplan.featuresel.limits.crlb import place_limits_um
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact

FRAMES = 16  # a square, so that their mean is like a picture of whole bits
_ROOT = math.isqrt(FRAMES)
_DRAWS = 400_000  # tell a quantile of .95 to .1 %


def limit_p95_um(case: LookCase, share: float) -> float:
    """Return the quantile of the distance that errors at the Cramer-Rao limit have.

    The zoom's scale is known here: about the axis it moves what is far from there.
    """
    known = replace(case, spread=replace(case.spread, magnification_sigma=0.0))
    sigmas = np.array(place_limits_um(known))
    errors = np.random.default_rng(0).standard_normal((_DRAWS, 2)) * sigmas
    return float(np.quantile(np.hypot(*errors.T), share))


def for_means(artifacts: Mapping[str, Artifact]) -> dict[str, Artifact]:
    """Return artifacts for means of `FRAMES` frames: their camera has less noise.

    As many times the electrons, and finer steps.
    """
    return {name: _quiet(artifact) for name, artifact in artifacts.items()}


def _quiet(artifact: Artifact) -> Artifact:
    """Return an artifact whose camera, if it knows of one, is that of a mean."""
    p = dict(artifact.parameters)
    if "full_well_e" not in p:
        return artifact
    p["full_well_e"] *= FRAMES
    p["read_noise_e"] *= _ROOT
    p["bits"] += math.log2(_ROOT)
    return replace(artifact, parameters=p)
