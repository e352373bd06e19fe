"""The likeliest pose one linear step from the guess: for the last cycles of a servo.

What `likelihood` finds, where its last answer or the servo's own model already says
within a third of a pixel where the target is and how far out of focus. In focus light
changes across an edge faster than that: after a step of more than a tenth of a pixel
another follows.
"""

from __future__ import annotations

import math

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    Measurement,
    Routine,
)
from microplan.featuresel.routines.likelihood.comparison import DefocusedImage
from microplan.featuresel.routines.likelihood.fit_problem import prepare_job, read_job
from microplan.featuresel.routines.likelihood.likelihood import answer
from microplan.featuresel.routines.likelihood.pose_fit import step_once
from microplan.featuresel.routines.likelihood.pose_start import start_pose
from microplan.featuresel.routines.picture import refused

_CAPTURE_PX = 0.35

_AGAIN_PX = 0.1  # a step that is shorter leaves nothing that noise would not hide


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the pose, px, after a step in `image`, (rows, columns) 0..1.

    Fails if that step is longer than a step may be.
    """
    if unfit := refused(image):
        return unfit
    if guess.z_um is None and artifact.parameters["focus_sigma_um"] > 0:
        return Failure("no_focus", "one step needs to know the focus")
    job, p = read_job((DefocusedImage(image=image),), artifact), artifact.parameters
    start = start_pose(job, p, guess)
    if isinstance(start, Failure):
        return start
    found = step_once(job, start)
    if isinstance(found, Failure):
        return found
    moved = math.hypot(found.pose.column - guess.column, found.pose.row - guess.row)
    if moved > 2 * _CAPTURE_PX:
        return Failure("not_captured", f"a step of {moved:.2f} px")
    if moved > _AGAIN_PX:
        found = step_once(job, found.pose)
    return found if isinstance(found, Failure) else answer(found, p, guess)


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    return 4.0 + 1e-4 * float(artifact.arrays["planes"].shape[2])


ONE_STEP = Routine(
    name="one_step",
    version="4",
    kinds=("circle", "teeth", "outline", "jaws"),
    provides=("xy", "theta", "z", "zoom"),
    requires=("xy", "theta", "z"),
    capture_px=_CAPTURE_PX,
    expensive=True,
    prepare=prepare_job,
    measure=measure,
    cost=cost,
)
