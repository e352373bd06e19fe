"""What drifts together is the same scene, and a picture moved."""

from __future__ import annotations

import numpy as np

from microplan.executor.simulated.imaging.solids.nearby import DRIFT_UM, drawn_back
from microplan.executor.simulated.imaging.solids.solid_scene import SolidScene
from microplan.schemas.pose import Pose
from tests.executor.simulated.imaging.bodies import body, box, circle, scene

FAR_UM = 100.0


def drifted(x_um: float, y_um: float) -> SolidScene:
    """Return two bodies, and one out of reach, all of them so far aside."""
    here = Pose(x_um=1.2 + x_um, y_um=3.4 + y_um, theta_rad=0.3)
    there = Pose(x_um=-7.7 + x_um, y_um=0.2 + y_um)
    away = Pose(x_um=500.0 + x_um, y_um=y_um)
    return scene(
        body([circle(0, 0, 20)], 0.0, 50.0, pose=here),
        body([box(0, 0, 9, 5)], 0.0, 20.0, pose=there),
        body([box(0, 0, 9, 5)], 0.0, 20.0, pose=away),
    )


def test_a_common_drift_is_taken_off() -> None:
    plain, way = drawn_back(drifted(0.0, 0.0), (0.0, 0.0), FAR_UM)
    moved, other = drawn_back(drifted(0.013, -0.021), (0.0, 0.0), FAR_UM)
    assert moved == plain
    assert len(plain.bodies) == 2
    # sums of numbers below 10 um round to 1e-15 of them; poses to 1e-6 um
    np.testing.assert_allclose(np.subtract(other, way), (0.013, -0.021), atol=2e-6)
    assert max(np.abs(way)) <= DRIFT_UM / 2


def test_a_body_that_moves_alone_makes_another_scene() -> None:
    one = drifted(0.0, 0.0)
    first = body([circle(0, 0, 20)], 0.0, 50.0, pose=Pose(x_um=1.3, y_um=3.4))
    other = scene(first, *one.bodies[1:])
    made = [drawn_back(each, (0.0, 0.0), FAR_UM)[0] for each in (one, other)]
    assert made[0] != made[1]


def test_nothing_near_is_an_empty_scene() -> None:
    assert drawn_back(drifted(900.0, 0.0), (0.0, 0.0), FAR_UM)[0].bodies == ()
