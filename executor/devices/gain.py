"""Which servo gains are stable on a station, by how old its frames are."""

from __future__ import annotations

import math

from microplan.executor.devices.calibration import IDENTITY, Calibration
from microplan.executor.devices.errors import ExecutorError
from microplan.schemas.plan import Plan


def stable_gain(latency_frames: int, turn_rad: float = 0.0) -> float:
    """Return the gain below which a servo that sees old frames settles.

    Parameters
    ----------
    latency_frames : int
        Looks by which a picture is older than it seems, d >= 0.
    turn_rad : float
        By which the image is turned against the stage, phi; at pi / 2 nothing settles.

    Returns
    -------
    float
        2 sin((pi / 2 - |phi|) / (2 d + 1)), 0 where nothing is stable.

    Notes
    -----
    e[k+1] = e[k] - g R(phi) e[k-d] has the roots of z^(d+1) - z^d + g e^(i phi). One
    leaves the unit circle at z = e^(i w) with |z - 1| = 2 sin(w / 2) = g and
    (2 d + 1) w / 2 = pi / 2 - |phi|.
    """
    if latency_frames < 0:
        raise ValueError(f"frames are {latency_frames} looks old, must be 0 or more")
    left_rad = max(math.pi / 2 - abs(turn_rad), 0.0)
    return 2 * math.sin(left_rad / (2 * latency_frames + 1))


def check_gains(
    plan: Plan, latency_frames: int, calibration: Calibration | None
) -> None:
    """Raise MP837 if an alignment's gain is not stable on the station.

    The image's scale counts into the gain, its turn into the limit.
    """
    (a, b), (c, d) = IDENTITY if calibration is None else calibration.camera_from_stage
    turn_rad = math.atan2(c - b, a + d)
    scale = math.hypot(a + d, c - b) / 2
    limit = stable_gain(latency_frames, turn_rad)
    for step in plan.steps:
        control = step.control
        if control is None or control.method != "servo":
            continue
        if not 0 < control.gain * scale < limit:
            raise ExecutorError(
                "MP837",
                f"step {step.id} corrects with gain {control.gain:g} on an image "
                f"scaled by {scale:.4g}; between 0 and {limit:.4g} is stable with "
                f"frames {latency_frames} looks old",
            )
