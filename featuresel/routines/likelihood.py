"""The maximum-likelihood pose: the image against what the optics say it should be.

The most accurate routine near its answer, and the only one that knows how far light and
blur may change: focus, zoom and light are free where the look's trials vary them. It
needs a guess within a pixel or two; the angle too, unless it is known within a few
degrees or repeats so soon.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from featuresel.routines import (
    Artifact,
    Camera,
    Failure,
    FloatArray,
    Guess,
    Known,
    LookModel,
    Measurement,
    Target,
    TargetKind,
)
from featuresel.routines.ambiguity import is_ambiguous, other_turns
from featuresel.routines.appearance import (
    FOCUS_SIGMAS,
    Pose,
    prepare_appearance,
    read_appearance,
)
from featuresel.routines.comparison import (
    Free,
    Front,
    Job,
    View,
    misfits,
    try_each,
)
from featuresel.routines.fronts import front_maps
from featuresel.routines.pose_fit import PoseFit, fit_pose

NAME = "likelihood"
VERSION = "1"
KINDS: tuple[TargetKind, ...] = ("circle", "teeth", "outline", "jaws")
GIVES: tuple[Known, ...] = ("xy", "theta", "z", "zoom")
NEEDS: tuple[Known, ...] = ("xy",)
CAPTURE_PX = 2.0
CONTROL = False
DEAR = True

_LEAST_SIGNAL = 0.03  # of full scale, that the target must vary by
_DEPTHS = (0.1, 0.35, 0.6, 0.85)  # of the reach in focus, where fits start
_SHARES = (-0.9, -0.5, 0.5, 0.7, 0.9)  # of the range of turns, where they are looked at
_BESIDE_PX = 2  # about what is not round, as its blur grows out of focus
_ZOOM_PX = 1.5  # that the rim moves by between zooms where fits start
_TURN_PX = 2.5  # that the rim moves by between turns where fits start
_MOST_TURNS = 64  # of them, at every focus height: more take too long
_WORST_CHI2 = 60.0  # worse is another thing; what trials show sets a finer gate
_LEAST_USED = 0.55  # share of pixels that must be the target's
_MOST_SPREAD_PX = 0.5  # of what an image tells: in more uncertainty nothing is found
_FAR_PX = 3.0  # the most that the fit may move from the guess


def prepare(model: LookModel, target: Target) -> Artifact | Failure:
    """Return the target's planes, what stands before it, and what is free."""
    return prepare_job(model, target)


def prepare_job(
    model: LookModel, target: Target, *, offset_um: float = 0.0
) -> Artifact | Failure:
    """Return what `read_job` reads, for images taken up to `offset_um` off focus."""
    reach_um = offset_um + FOCUS_SIGMAS * model.drifts.focus_sigma_um
    image = model()
    if float(np.ptp(image)) < _LEAST_SIGNAL:
        return Failure(code="no_contrast", message="the target does not stand out")
    turns = _turns_show(model, target, image)
    made = prepare_appearance(
        model,
        target,
        image.shape,
        turns=turns,
        reach_um=reach_um,
        ignored=None if turns else _turning(model, image, _within(target)),
    )
    reach = max(reach_um, 1.0)
    front = front_maps(model, target, image, reach)
    arrays = dict(made.arrays)
    if front is not None:
        arrays["front_light"] = front.light.astype(np.float32)
        arrays["front_through"] = front.through.astype(np.float32)
    if turns and target.symmetry > 1:
        arrays["odd"] = _odd_cells(model, target, image, made)
    camera, drifts = model.camera, model.drifts
    return Artifact(
        parameters={
            **made.parameters,
            "turns": float(turns),
            "theta_rad": target.theta_rad,
            "symmetry": float(max(target.symmetry, 1)),
            "range_rad": target.theta_range_rad,
            "focus_sigma_um": drifts.focus_sigma_um,
            "zoom_sigma": drifts.zoom_sigma,
            "gradient": drifts.gradient,
            "front_reach_um": reach,
            "axis_column": drifts.axis_px[0],
            "axis_row": drifts.axis_px[1],
            "full_well_e": camera.full_well_e,
            "read_noise_e": camera.read_noise_e,
            "bits": float(camera.bits),
            "fill_factor": camera.fill_factor,
        },
        arrays=arrays,
    )


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the likeliest pose near the guess; fails if too little of it fits."""
    job, p = read_job((View(image=image),), artifact), artifact.parameters
    start = start_pose(job, p, guess)
    if isinstance(start, Failure):
        return start
    found = fit_pose(job, start)
    if isinstance(found, Failure):
        return found
    if p["symmetry"] > 1 and p["turns"] and guess.z_um is None:
        found = _other_turns(job, artifact, found)
        others = other_turns(found.pose.turn_rad, p["symmetry"], p["range_rad"])
        if is_ambiguous(job, found.pose, others):
            return Failure(code="ambiguous", message="another turn fits as well")
    return answer(found, p, guess)


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `featuresel.routines.Routine`."""
    cells = artifact.arrays["planes"].shape[2]
    return 4.0 + 3e-4 * float(cells)


def read_job(views: tuple[View, ...], artifact: Artifact) -> Job:
    """Return images with all that they are compared with."""
    p, arrays = artifact.parameters, artifact.arrays
    front = None
    if "front_light" in arrays:
        front = Front(
            light=arrays["front_light"].astype(np.float64),
            through=arrays["front_through"].astype(np.float64),
            reach_um=p["front_reach_um"],
            axis_px=(p["axis_column"], p["axis_row"]),
        )
    return Job(
        views=views,
        looks=read_appearance(artifact),
        front=front,
        camera=Camera(
            full_well_e=p["full_well_e"],
            read_noise_e=p["read_noise_e"],
            bits=int(p["bits"]),
            fill_factor=p["fill_factor"],
        ),
        free=Free(
            turn=p["turns"] > 0,
            z_sigma_um=p["focus_sigma_um"],
            zoom_sigma=p["zoom_sigma"],
            gradient=p["gradient"] > 0,
        ),
    )


def start_pose(job: Job, p: Mapping[str, float], guess: Guess) -> Pose | Failure:
    """Return where the fit starts: focus and angle that fit best, if not known."""
    turns = _turns(job, p, guess)
    if isinstance(turns, Failure):
        return turns
    depths = [guess.z_um or 0.0]
    if guess.z_um is None and p["focus_sigma_um"] > 0:
        depths = _depths(job)
    pose = Pose(
        column=guess.column,
        row=guess.row,
        turn_rad=turns[len(turns) // 2],
        z_um=depths[0],
        zoom=guess.zoom or 1.0,
    )
    zooms = [pose.zoom] if guess.zoom is not None else _zooms(job, p)
    if len(zooms) > 1:  # focus and zoom first: all at once would be too many
        pose = try_each(job, pose, turns=[pose.turn_rad], depths=depths, zooms=zooms)
        depths, zooms = [pose.z_um], [pose.zoom]
    if len(depths) * len(turns) == 1:
        return pose
    return try_each(job, pose, turns=turns, depths=depths, zooms=zooms)


def _zooms(job: Job, p: Mapping[str, float]) -> list[float]:
    """Return zooms to start at, within two standard deviations of nominal."""
    rim_px = max(job.looks.shape) / 2 / job.looks.over
    reach = 2 * p["zoom_sigma"]
    count = math.ceil(2 * reach * rim_px / _ZOOM_PX)
    return [1 + reach * ((2 * k + 1) / count - 1) for k in range(count)] or [1.0]


def _turns_show(model: LookModel, target: Target, image: FloatArray) -> bool:
    """Return whether a turn within the target's range changes the image."""
    turn = min(target.theta_range_rad, math.pi / max(target.symmetry, 1)) / 2
    rim_px = target.parameters.get("radius_um", 0.0) * target.px_per_um
    if turn == 0 or 4 * turn * rim_px > _MOST_TURNS * _TURN_PX:
        # a circle whose surroundings may lie at any angle: they are not its own
        return turn > 0 and target.kind != "circle"
    return float(np.abs(model(theta_rad=turn) - image).max()) > _LEAST_SIGNAL


def _within(target: Target) -> list[float]:
    """Return some turns within the target's range."""
    return [share * target.theta_range_rad for share in _SHARES]


def _turning(
    model: LookModel, image: FloatArray, turns: list[float]
) -> npt.NDArray[np.bool_]:
    """Return pixels that change with nearly all of some turns: what turns, shows."""
    change = [np.abs(model(theta_rad=turn) - image) for turn in turns if turn != 0]
    if not change:
        return np.zeros(image.shape, dtype=bool)
    kernel = np.ones((2 * _BESIDE_PX + 1, 2 * _BESIDE_PX + 1), np.uint8)
    marked = np.median(change, axis=0) > _LEAST_SIGNAL / 2
    return np.asarray(cv2.dilate(marked.astype(np.uint8), kernel) > 0)


def _odd_cells(
    model: LookModel, target: Target, image: FloatArray, made: Artifact
) -> npt.NDArray[np.float32]:
    """Return cells of the template that a turn by whole periods changes."""
    period, order = 2 * math.pi / target.symmetry, target.symmetry
    turns = [round(share * order) * period for share in _SHARES]
    rows, columns = np.nonzero(_turning(model, image, turns))
    where, over = made.arrays["cells"], int(made.parameters["over"])
    row = (where.shape[0] - 1) // 2 + over * (rows - round(target.row))
    column = (where.shape[1] - 1) // 2 + over * (columns - round(target.column))
    inside = (row >= 0) & (row < where.shape[0])
    inside &= (column >= 0) & (column < where.shape[1])
    flat = row[inside] * where.shape[1] + column[inside]
    kept = where.ravel()[flat] > 0
    return np.asarray(flat[kept], dtype=np.float32)


def _turns(job: Job, p: Mapping[str, float], guess: Guess) -> list[float] | Failure:
    """Return turns to start at: the guess's, or all within a period of the pattern.

    The nominal angle is no measurement: the true one is anywhere in its range.
    """
    if not p["turns"]:
        return [0.0]
    known = guess.theta_rad is not None and guess.theta_rad != p["theta_rad"]
    if guess.theta_rad is not None and (known or p["range_rad"] >= math.pi):
        return [math.remainder(guess.theta_rad - p["theta_rad"], 2 * math.pi)]
    rim_px = max(job.looks.shape) / 2 / job.looks.over
    reach = min(p["range_rad"], math.pi / p["symmetry"])
    count = math.ceil(2 * reach * rim_px / _TURN_PX)
    if count > _MOST_TURNS:
        return Failure(code="no_angle", message="the fit needs an angle to start at")
    return [reach * ((2 * k + 1) / count - 1) for k in range(count)]


def _depths(job: Job) -> list[float]:
    """Return focus heights to start at, on both sides where they look different."""
    farthest = max(abs(view.dz_um) for view in job.views)
    ahead = [share * (job.looks.reach_um - farthest) for share in _DEPTHS]
    return ahead if job.squared else [*ahead, *(-z for z in ahead)]


def _other_turns(job: Job, artifact: Artifact, found: PoseFit) -> PoseFit:
    """Return the fit at that of the equal turns which what breaks the symmetry tells.

    Half a period too: beyond the first sign change of the transfer function teeth and
    gaps swap.
    """
    count, here = int(artifact.parameters["symmetry"]), found.pose
    odd = artifact.arrays.get("odd")
    if odd is None or len(odd) == 0:
        return found
    steps = np.array([0.0, -0.5, 0.5, *range(1, count)])
    turns = here.turn_rad + steps * 2 * math.pi / count
    left = misfits(job, here, turns, odd.astype(np.intp))
    best = int(np.argmin(left))
    if best == 0 or not math.isfinite(left[best]):
        return found
    other = fit_pose(job, replace(here, turn_rad=float(turns[best])))
    if isinstance(other, Failure) or other.chi2 >= found.chi2:
        return found
    return other


def answer(
    found: PoseFit, p: Mapping[str, float], guess: Guess
) -> Measurement | Failure:
    """Return the measurement, or why the fit cannot be believed."""
    pose = found.pose
    if found.chi2 > _WORST_CHI2 or found.used < _LEAST_USED:
        return Failure(
            code="misfit",
            message=f"chi squared {found.chi2:.1f} a pixel, {found.used:.0%} of the "
            f"pixels fit",
        )
    moved = math.hypot(pose.column - guess.column, pose.row - guess.row)
    if moved > _FAR_PX:
        return Failure(code="outside", message=f"{moved:.1f} px from the guess")
    theta = None
    if p["turns"]:
        theta = math.remainder(p["theta_rad"] + pose.turn_rad, 2 * math.pi)
        turned = abs(math.remainder(pose.turn_rad, 2 * math.pi))
        if turned > 1.2 * p["range_rad"] + 0.01:
            return Failure(code="outside", message=f"turned by {turned:.3f} rad")
    sigma = found.sigma
    if not max(sigma[0], sigma[1]) < _MOST_SPREAD_PX:  # also nan
        return Failure(
            code="no_contrast",
            message=f"the place is uncertain by {max(sigma[0], sigma[1]):.2f} px",
        )
    return Measurement(
        column=pose.column,
        row=pose.row,
        theta_rad=theta,
        score=found.used / max(1.0, found.chi2),
        spread_px=float(max(sigma[0], sigma[1])),
        spread_theta_rad=float(sigma[2]) if p["turns"] else None,
        z_um=pose.z_um if p["focus_sigma_um"] > 0 else None,
        spread_z_um=float(sigma[3]) if p["focus_sigma_um"] > 0 else None,
        zoom=pose.zoom if p["zoom_sigma"] > 0 else None,
    )
