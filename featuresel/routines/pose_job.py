"""What a fit of the pose compares images with: prepared once, kept in an artifact."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from featuresel.routines import (
    Artifact,
    Camera,
    Failure,
    FloatArray,
    LookModel,
    Target,
)
from featuresel.routines.appearance import read_appearance
from featuresel.routines.comparison import Free, Front, Job, View
from featuresel.routines.fronts import front_maps
from featuresel.routines.planes import FOCUS_SIGMAS, prepare_planes

_LEAST_SIGNAL = 0.03  # of full scale, that the target must vary by
_SHARES = (-0.9, -0.5, 0.5, 0.7, 0.9)  # of the range of turns, where they are looked at
_BESIDE_PX = 2  # about what is not round, as its blur grows out of focus
_MOST_ARC_PX = 160.0  # that turns may move a circle's rim by: beyond, it is round


def prepare_job(
    model: LookModel, target: Target, *, offset_um: float = 0.0
) -> Artifact | Failure:
    """Return what `read_job` reads, for images taken up to `offset_um` off focus."""
    reach_um = offset_um + FOCUS_SIGMAS * model.drifts.focus_sigma_um
    image = model()
    if float(np.ptp(image)) < _LEAST_SIGNAL:
        return Failure(code="no_contrast", message="the target does not stand out")
    turns = _turns_show(model, target, image)
    made = prepare_planes(
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


def _turns_show(model: LookModel, target: Target, image: FloatArray) -> bool:
    """Return whether a turn within the target's range changes the image."""
    turn = min(target.theta_range_rad, math.pi / max(target.symmetry, 1)) / 2
    rim_px = target.parameters.get("radius_um", 0.0) * target.px_per_um
    if turn == 0 or 4 * turn * rim_px > _MOST_ARC_PX:
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
