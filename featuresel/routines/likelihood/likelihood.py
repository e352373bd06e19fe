"""The maximum-likelihood pose: the image against what the optics say it should be.

The most accurate routine near its answer, and the only one that knows how far light and
blur may change: focus, zoom and light are free where the look's trials vary them. It
needs a guess within a pixel or two; the angle too, unless it is known within a few
degrees or repeats so soon.

`one_step` finds the same by one linear step, for the last cycles of a servo, where its
last answer or the servo's own model already says within a third of a pixel where the
target is and how far out of focus. In focus light changes across an edge faster than
that: after a step of more than a tenth of a pixel another follows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray, IntArray
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    Measurement,
    Routine,
)
from microplan.featuresel.routines.likelihood.appearance import (
    ImagePose,
    OccluderBlur,
)
from microplan.featuresel.routines.likelihood.comparison import (
    DefocusedImage,
    ImageComparison,
)
from microplan.featuresel.routines.likelihood.fit_problem import prepare_job, read_job
from microplan.featuresel.routines.likelihood.pose_fit import (
    PoseFit,
    excess,
    fit_pose,
    step_once,
    surfaces_first,
)
from microplan.featuresel.routines.likelihood.pose_start import (
    equal_turns,
    is_marked,
    marks,
    other_turns,
    refocused,
    start_pose,
)

_WORST_CHI2 = 60.0  # worse is another thing; what trials show sets a finer gate
# Share of what edges tell that must fit: dust takes a fifteenth, a notch an eighth.
_LEAST_USED = 0.9
_MOST_SPREAD_PX = 0.5  # standard deviation: in more uncertainty nothing is found
_DIMMEST = 0.02  # of the nominal light: less is rounding
_STEP_CAPTURE_PX = 0.35  # how far off one step starts
_AGAIN_PX = 0.1  # a step that is shorter leaves nothing that noise would not hide
_FAR_PX = 3.0  # the most that the fit may move from the guess
# Standard deviations of chi squared that noise explains; beyond, the focus may have the
# wrong sign.
_DOUBTFUL = 2.0
_REFUTED = 4.0  # standard deviations: then a side of focus is not the right one
_AS_MUCH = 0.95  # of the pixels that another fit trusts


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the likeliest pose, px, near the guess in `image`, (rows, columns) 0..1.

    Fails if too little of the image fits.
    """
    job, p = read_job((DefocusedImage(image=image),), artifact), artifact.parameters
    start = start_pose(job, p, guess)
    if isinstance(start, Failure):
        return start
    marked = artifact.arrays.get("odd", np.zeros(0)).astype(np.intp)
    if len(marked) == 0 or guess.z_um is not None:
        found = _freed(job, start)
    else:
        found = fitted(job.held, start)
        if isinstance(found, PoseFit):
            found = _at_mark(job.held, found, marked, p["range_rad"])
        if isinstance(found, PoseFit) and job.front is not None:
            found = fitted(job, found.pose)  # at a wrong turn it would mend that
    if isinstance(found, PoseFit) and guess.z_um is None:
        found = _sided(job, found)
    return found if isinstance(found, Failure) else answer(found, p, guess)


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    cells = artifact.arrays["planes"].shape[2]
    return 4.0 + 3e-4 * float(cells)


LIKELIHOOD = Routine(
    name="likelihood",
    version="11",
    kinds=("circle", "teeth", "outline", "jaws"),
    principle="area",
    provides=("xy", "theta", "z", "zoom"),
    requires=("xy",),
    capture_px=2.0,
    expensive=True,
    prepare=prepare_job,
    measure=measure,
    cost=cost,
)


def measure_step(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the pose, px, after a step in `image`, (rows, columns) 0..1.

    Fails if that step is longer than a step may be.
    """
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
    if moved > 2 * _STEP_CAPTURE_PX:
        return Failure("not_captured", f"a step of {moved:.2f} px")
    if moved > _AGAIN_PX:
        found = step_once(job, found.pose)
    return found if isinstance(found, Failure) else answer(found, p, guess)


def step_cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure_step`, see `contract.Routine`."""
    return 4.0 + 1e-4 * float(artifact.arrays["planes"].shape[2])


ONE_STEP = Routine(
    name="one_step",
    version="8",
    kinds=("circle", "teeth", "outline", "jaws"),
    principle="area",
    provides=("xy", "theta", "z", "zoom"),
    requires=("xy", "theta", "z"),
    capture_px=_STEP_CAPTURE_PX,
    expensive=True,
    prepare=prepare_job,
    measure=measure_step,
    cost=step_cost,
)


def _freed(job: ImageComparison, start: ImagePose) -> PoseFit | Failure:
    """Return the fit of the pose together with the occluder, if anything does.

    Held as planned where it is not, that draws the pose's focus and zoom away, and from
    there the fit of both may not come back. It settles where both together do not; one
    that settles is not doubted here but by `answer`.
    """
    found = fit_pose(job, surfaces_first(job, start))
    if isinstance(found, PoseFit):
        found = _righted(job, found)
        veiled = _veiled(job, found)
        return found if veiled is found else _righted(job.veiled, veiled)
    if job.front is None:
        return _instead(job, found, start)
    near = fitted(job.held, start)
    return near if isinstance(near, Failure) else fitted(job, near.pose)


def _righted(job: ImageComparison, found: PoseFit) -> PoseFit:
    """Return a fit that noise explains, else the better one of both signs of focus.

    From a start that is off, a fit may settle as far out of focus on the other side.
    The other one is better if it explains as much of the target by more than noise.
    """
    noise = math.sqrt(2 / found.pixels)
    if job.front is None or found.quality.left <= 1 + _DOUBTFUL * noise:
        return found
    pose, blur = found.pose, found.pose.occluder_blur
    there = replace(
        pose,
        z_um=pose.z_um if job.squared else -pose.z_um,
        front=OccluderBlur(focus_um=-blur.focus_um),
    )
    other = fit_pose(job, surfaces_first(job, there))
    if isinstance(other, Failure) or other.quality.used < _AS_MUCH * found.quality.used:
        return found
    return other if other.quality.left < found.quality.left - noise else found


def _sided(job: ImageComparison, found: PoseFit) -> PoseFit:
    """Return the better fit of both sides of focus, where images of both differ.

    It has a sign if the other one is refuted, or if both starts end on one side or in
    one place. What model and image differ by beyond noise counts as more noise. Behind
    an occluder, whose own focus is free, `_righted` compares both instead.
    """
    if job.squared or job.front is not None or job.free.z_sigma_um == 0:
        return found
    other = fitted(job, replace(found.pose, z_um=-found.pose.z_um))
    if isinstance(other, Failure):
        return found
    z_um, there_um = found.pose.z_um, other.pose.z_um
    if abs(z_um - there_um) < found.sigma[3]:
        return replace(found, is_signed=True)
    more = excess(job, found, other)
    better = other if more < 0 else found
    refuted = abs(more) > _REFUTED**2 * max(1.0, better.quality.chi2)
    return replace(better, is_signed=refuted or z_um * there_um > 0)


def _veiled(job: ImageComparison, found: PoseFit) -> PoseFit:
    """Return a fit that noise explains, else a better one with a veil, if any.

    A veil: light all over and a bent response. Black levels and responses that nobody
    stated, and stray light, are that first of all. Free from the start it would cost
    focus a third of what images tell of it. Without it the fit may have ended far out
    of focus: then the veiled one starts anew.
    """
    noise, plain, veiled = math.sqrt(2 / found.pixels), found.quality, job.veiled
    if plain.left <= 1 + _DOUBTFUL * noise:
        return found
    for again in (False, True):
        start = found.pose
        if again:
            start = refocused(veiled, replace(start, zoom=1.0))
        other = fit_pose(veiled, start)
        if isinstance(other, Failure) or other.quality.left > plain.left - noise:
            continue
        if other.quality.score >= plain.score:  # else it fits dust
            return other
    return found


def fitted(job: ImageComparison, start: ImagePose) -> PoseFit | Failure:
    """Return the fit from a start, with a veil if it needs one."""
    found = fit_pose(job, start)
    if isinstance(found, Failure):
        return _instead(job, found, start)
    return _veiled(job, found)


def _instead(
    job: ImageComparison, failure: Failure, start: ImagePose
) -> PoseFit | Failure:
    """Return the fit with a veil where the plain one failed, else how that failed."""
    other = fit_pose(job.veiled, start)
    return failure if isinstance(other, Failure) else other


def _at_mark(
    job: ImageComparison, found: PoseFit, cells: IntArray, range_rad: float
) -> PoseFit | Failure:
    """Return the fit at the one of equal rotations that the symmetry's breach confirms.

    Half a period too: beyond the first sign change of the transfer function teeth and
    gaps swap.
    """
    turns = equal_turns(found.pose.turn_rad, job.symmetry)
    seen = marks(job, found, turns, cells)
    best = int(np.argmax(seen.share))
    if best > 0:
        start = replace(found.pose, turn_rad=float(turns[best]))
        other = fitted(job, start)
        if isinstance(other, PoseFit):
            found = other if other.quality.left < found.quality.left else found
            turns = equal_turns(found.pose.turn_rad, job.symmetry)
            seen = marks(job, found, turns, cells)
    alone = len(other_turns(found.pose.turn_rad, job.symmetry, range_rad)) == 0
    if alone or is_marked(seen):
        return found
    return Failure(
        "ambiguous", f"{seen.share[0]:.0%} of what breaks the symmetry shows"
    )


def answer(
    found: PoseFit, p: Mapping[str, float], guess: Guess
) -> Measurement | Failure:
    """Return the measurement, or why the fit cannot be believed."""
    pose, how = found.pose, found.quality
    if found.gain < _DIMMEST:
        return Failure("too_dim", f"{found.gain:.2g} of the nominal light")
    if how.chi2 > _WORST_CHI2 or how.used < _LEAST_USED:
        return Failure(
            "misfit",
            f"chi squared {how.chi2:.1f} a pixel, {how.used:.0%} of the edges fit",
        )
    if abs(pose.zoom - 1) > p.get("scale_off", math.inf):  # inf: of an older plan
        return Failure("scale_off", f"{pose.zoom:.3f} times the size")
    moved = math.hypot(pose.column - guess.column, pose.row - guess.row)
    if moved > _FAR_PX:
        return Failure("outside", f"{moved:.1f} px from the guess")
    theta = None
    if p["turns"]:
        theta = math.remainder(p["theta_rad"] + pose.turn_rad, 2 * math.pi)
        turned = abs(math.remainder(pose.turn_rad, 2 * math.pi))
        if turned > 1.2 * p["range_rad"] + 0.01:
            return Failure("outside", f"turned by {turned:.3f} rad")
    sigma = found.sigma
    if not max(sigma[0], sigma[1]) < _MOST_SPREAD_PX:  # also nan
        return Failure(
            "no_contrast", f"the place is uncertain by {max(sigma[0], sigma[1]):.2f} px"
        )
    return Measurement(
        column=pose.column,
        row=pose.row,
        theta_rad=theta,
        score=how.score,
        spread_px=float(max(sigma[0], sigma[1])),
        spread_theta_rad=float(sigma[2]) if p["turns"] else None,
        z_um=found.z_um if p["focus_sigma_um"] > 0 else None,
        spread_z_um=float(sigma[3]) if p["focus_sigma_um"] > 0 else None,
        z_is_signed=found.is_signed,
        zoom=pose.zoom if p["zoom_sigma"] > 0 else None,
    )
