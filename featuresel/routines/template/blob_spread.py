"""How far a blob's centroid is off on a look's own images, noise among it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import Failure, Guess, LookModel, Target
from microplan.featuresel.routines.contract import Measurement as Found

Find = Callable[[FloatArray, Guess], Found | Failure]

# sub-pixel places, px, turns as shares of what is possible, focus errors in sigmas: a
# normal law's fourth moment is that of -sqrt(3), 0 and sqrt(3) with 1/6, 2/3 and 1/6
_POSES = (
    (0.0, 0.0, 0.0, 0.0),
    (0.31, 0.52, 0.37, math.sqrt(3)),
    (0.48, -0.33, -0.42, 0.0),
    (-0.37, 0.18, 0.81, 0.0),
    (-0.16, -0.44, -0.87, -math.sqrt(3)),
    (0.14, 0.27, 0.63, 0.0),
)
_SEED = 4157  # any: the noise of the images is drawn, always alike
LEAST_PX = 0.01  # six images tell a spread to a third of it


def spread_px(render: LookModel, target: Target, find: Find) -> float | None:
    """Return the rms error per axis of a centroid, px; None if most are not found.

    Over poses between pixels, turns and focus errors as the trials have them, each with
    the camera's noise. Light gradients are not among them.
    """
    rng = np.random.default_rng(_SEED)
    errors = []
    for dx, dy, turn, sigmas in _POSES:
        theta_rad = turn * min(target.theta_range_rad, math.pi)
        image = render(
            dx_um=dx / target.px_per_um,
            dy_um=dy / target.px_per_um,
            theta_rad=theta_rad,
            dz_um=sigmas * render.drifts.focus_sigma_um,
        )
        noise = np.sqrt(render.camera.variance(image))
        found = find(
            np.clip(image + noise * rng.standard_normal(image.shape), 0.0, 1.0),
            Guess(
                column=target.column + dx,
                row=target.row - dy,
                theta_rad=target.theta_rad + theta_rad,
            ),
        )
        if not isinstance(found, Failure):
            right = found.column - target.column - dx
            errors.append((right, found.row - target.row + dy))
    if 2 * len(errors) < len(_POSES):
        return None
    worse = float(np.square(errors).mean(axis=0).max())
    return max(math.sqrt(worse), LEAST_PX)
