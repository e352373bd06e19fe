"""Steps of a pose fit: how far they may go, and the pose after them."""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.likelihood.appearance import (
    AGAIN_PX,
    ImagePose,
    OccluderBlur,
)
from microplan.featuresel.routines.likelihood.comparison import (
    LIGHT,
    ImageComparison,
)

_FAR_PX = 1.5  # the most that one step may move the image
_MOST_CORE = 0.3  # beyond, it would stand for another focus of the occluder
_MOST_MODE = 5.0  # standard deviations: what lies farther off was not planned for
_ZOOMS = (0.8, 1.25)  # beyond, nothing that starts near nominal gets


def shortened(
    job: ImageComparison, pose: ImagePose, move: FloatArray, depths: float
) -> float:
    """Return the share of a step (P + L,), px, rad, um, that slopes hold for, 0..1."""
    far = _moved_px(job, math.hypot(move[0], move[1]), move[2], move[4])
    most = depths * job.looks.step_um
    if job.squared:
        most *= 2 * abs(pose.z_um) + most
    return float(1 / max(1.0, far / _FAR_PX, abs(move[3]) / most))


def pose_after(job: ImageComparison, pose: ImagePose, move: FloatArray) -> ImagePose:
    """Return the pose after a step (P + L,), px, rad, um, within the planes' focus."""
    farthest = max(abs(view.dz_um) for view in job.views)
    reach, z_um = job.looks.reach_um - farthest, job.focus(pose) + float(move[3])
    if job.squared:
        z_um = math.sqrt(max(z_um, 0.0))
    z_um = min(max(z_um, -reach), reach)
    return ImagePose(
        column=pose.column + float(move[0]),
        row=pose.row + float(move[1]),
        turn_rad=pose.turn_rad + float(move[2]),
        z_um=z_um,
        zoom=min(max(pose.zoom + float(move[4]), _ZOOMS[0]), _ZOOMS[1]),
        front=_front(job, pose, z_um, move[5:-LIGHT]),
    )


def _front(
    job: ImageComparison, pose: ImagePose, z_um: float, move: FloatArray
) -> OccluderBlur | None:
    """Return how the occluder is blurred after a step, within its maps."""
    if job.front is None:
        return pose.front
    was, reach = pose.occluder_blur, job.front.reach_um
    if job.free.front_sigmas is None:
        return OccluderBlur(
            focus_um=math.copysign(z_um, was.focus_um) if job.squared else z_um
        )
    return OccluderBlur(
        focus_um=min(max(was.focus_um + float(move[0]), -reach), reach),
        core=min(max(was.core + float(move[1]), -_MOST_CORE), _MOST_CORE),
        occluder_modes=tuple(
            np.clip(modes_of(job, was) + move[2:], -_MOST_MODE, _MOST_MODE).tolist()
        ),
    )


def modes_of(job: ImageComparison, front: OccluderBlur) -> FloatArray:
    """Return the occluder modes' amounts, (S,), in standard deviations."""
    return np.array(front.occluder_modes or (0.0,) * job.free.occluder_modes)


def _moved_px(
    job: ImageComparison, place_px: float, turn_rad: float, zoom: float
) -> float:
    """Return how far a move, rotation or zoom takes anything in the template."""
    rim_px = max(job.looks.shape) / 2 / job.looks.over
    return max(place_px, abs(turn_rad) * rim_px, abs(zoom) * rim_px)


def is_elsewhere(job: ImageComparison, one: ImagePose, other: ImagePose) -> bool:
    """Return whether other pixels tell most at the other pose."""
    place_px = math.hypot(one.column - other.column, one.row - other.row)
    turn_rad, zoom = one.turn_rad - other.turn_rad, one.zoom - other.zoom
    far = _moved_px(job, place_px, turn_rad, zoom) > AGAIN_PX
    return far or abs(one.z_um - other.z_um) > job.looks.step_um
