"""Bodies that matter to a piece of a picture, less what they drift by together."""

from __future__ import annotations

import math
from dataclasses import replace

from microplan.executor.simulated.imaging.solids.solid_scene import SolidScene
from microplan.schemas.pose import Pose

DRIFT_UM = 0.5  # a drift by less is no other scene, but a picture moved
PLACE_DIGITS = 6  # of um: what sums left a rounding apart is the same


def drawn_back(
    scene: SolidScene, middle: tuple[float, float], reach_um: float
) -> tuple[SolidScene, tuple[float, float]]:
    """Return the bodies within a reach of a middle, less a common way, and that way.

    Where all bodies drift together by less than `DRIFT_UM`, the scene is the same: its
    picture has moved, and nothing is computed anew.

    Parameters
    ----------
    scene : SolidScene
        All bodies.
    middle : (float, float)
        A point of the world, um.
    reach_um : float
        How far from it bodies matter.

    Returns
    -------
    scene : SolidScene
        Bodies at poses less the way, rounded.
    way : (float, float)
        At most `DRIFT_UM` / 2 along x and y.
    """
    bodies = [b for b in scene.bodies if b.away_um(*middle) < reach_um]
    if not bodies:
        return replace(scene, bodies=()), (0.0, 0.0)
    first = bodies[-1].pose
    dx, dy = (math.remainder(v, DRIFT_UM) for v in (first.x_um, first.y_um))
    back = tuple(
        replace(
            body,
            pose=Pose(
                x_um=round(body.pose.x_um - dx, PLACE_DIGITS),
                y_um=round(body.pose.y_um - dy, PLACE_DIGITS),
                theta_rad=body.pose.theta_rad,
            ),
        )
        for body in bodies
    )
    return replace(scene, bodies=back), (dx, dy)
