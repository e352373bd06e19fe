"""What a fit of the pose compares images with: prepared once, kept in an artifact."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import (
    Artifact,
    CameraNoise,
    Failure,
    LookModel,
    Target,
    scale_limit,
)
from microplan.featuresel.routines.likelihood.appearance import read_appearance
from microplan.featuresel.routines.likelihood.comparison import (
    DefocusedImage,
    Free,
    ImageComparison,
)
from microplan.featuresel.routines.likelihood.foreground import Front, mode_maps
from microplan.featuresel.routines.likelihood.front_maps import (
    MOST_TURN_RAD,
    front_maps,
)
from microplan.featuresel.routines.likelihood.joint_blur import (
    joint_artifact,
    read_joint,
)
from microplan.featuresel.routines.likelihood.planes import FOCUS_SIGMAS, prepare_planes
from microplan.featuresel.routines.likelihood.pose_start import farthest_rad
from microplan.featuresel.routines.likelihood.spline import runout_coefficients
from microplan.featuresel.routines.likelihood.surface_maps import surface_maps

_LEAST_SIGNAL = 0.03  # of full scale, that the target must vary by
_SHARES = (-0.9, -0.5, 0.5, 0.7, 0.9)  # of the range of turns, where they are looked at
_BESIDE_PX = 2  # about what is not round, as its blur grows out of focus
# Wave depths of field, that defocus models may differ by in the occluders'
# height: Hopkins' model and the exact one by 2 % of 130 um at an aperture of .42.
_APART_DEPTHS = 1.0
_BEYOND = 2.0  # times that, what the maps reach to beyond the focus
_CORE_SIGMA = 0.1  # share that they may differ by in the core of a blur: so they do
_MOST_ARC_PX = 160.0  # that turns may move a circle's rim by: beyond, it is round


def prepare_job(
    model: LookModel, target: Target, *, offset_um: float = 0.0
) -> Artifact | Failure:
    """Return what `read_job` reads, for images taken up to `offset_um` off focus."""
    reach_um = offset_um + FOCUS_SIGMAS * model.nuisances.focus_sigma_um
    image = model()
    if float(np.ptp(image)) < _LEAST_SIGNAL:
        return Failure("no_contrast", "the target does not stand out")
    turns = _turns_show(model, target, image)
    odd_px = None
    if turns and target.symmetry > 1:
        odd_px = _odd_px(model, target, (0.0, reach_um))
    made = prepare_planes(
        model,
        target,
        image.shape,
        turns=turns,
        reach_um=reach_um,
        ignored=None if turns else _turning(model, _within(target)),
        also_px=None
        if odd_px is None
        else _turned_px(odd_px, farthest_rad(target.symmetry)),
    )
    apart_um = _APART_DEPTHS * model.blur.depth_um
    front = front_maps(model, target, image, reach_um + _BEYOND * apart_um)
    arrays, numbers = dict(made.arrays), dict(made.parameters)
    if front is not None:
        maps = {
            "front_light": front.light,
            "front_through": front.through,
            "front_core_light": front.core_light,
            "front_core_through": front.core_through,
        }
        for name, values in maps.items():
            arrays[name] = runout_coefficients(values).astype(np.float32)
        modes = mode_maps(model, image)
        light, through = modes.light, modes.through
        surfaces = surface_maps(model, target, image)
        if surfaces is not None:
            light = np.concatenate((light, surfaces.light))
            through = np.concatenate((through, surfaces.through))
            arrays["front_surface_moved"] = surfaces.moved.astype(np.float32)
            numbers |= {
                "front_column": target.column,
                "front_row": target.row,
                "front_far_px": surfaces.far_px,
            }
        arrays["front_sway_light"] = light.astype(np.float32)
        arrays["front_sway_through"] = through.astype(np.float32)
        joint = joint_artifact(front, target)
        if joint is not None and not (turns and target.theta_range_rad > MOST_TURN_RAD):
            arrays |= joint.arrays
            numbers |= joint.parameters
    if odd_px is not None:
        arrays["odd"] = _cells(odd_px, made)
    camera, drifts = model.camera, model.nuisances
    if camera.table is not None:
        arrays["camera_noise"] = camera.table.astype(np.float32)
        numbers |= {"camera_floor": camera.floor, "camera_ceiling": camera.ceiling}
    return Artifact(
        parameters={
            **numbers,
            "turns": float(turns),
            "theta_rad": target.theta_rad,
            "symmetry": float(max(target.symmetry, 1)),
            "range_rad": target.theta_range_rad,
            "focus_sigma_um": drifts.focus_sigma_um,
            "zoom_sigma": drifts.zoom_sigma,
            "scale_off": scale_limit(target, drifts.zoom_sigma),
            "gradient": drifts.gradient,
            "front_reach_um": reach_um + _BEYOND * apart_um,
            "front_focus_sigma_um": drifts.focus_sigma_um + apart_um,
            "front_core_sigma": _CORE_SIGMA,
            "axis_column": drifts.axis_px[0],
            "axis_row": drifts.axis_px[1],
            "full_well_e": camera.full_well_e,
            "read_noise_e": camera.read_noise_e,
            "bits": float(camera.bits),
            "misfit": camera.misfit,
            "fill_factor": camera.fill_factor,
        },
        arrays=arrays,
    )


def read_job(views: tuple[DefocusedImage, ...], artifact: Artifact) -> ImageComparison:
    """Return images with all that they are compared with."""
    p, arrays = artifact.parameters, artifact.arrays
    front, sigmas = None, None
    noise = arrays.get("camera_noise")
    if "front_light" in arrays:
        front = Front(
            light=arrays["front_light"],
            through=arrays["front_through"],
            core_light=arrays["front_core_light"],
            core_through=arrays["front_core_through"],
            reach_um=p["front_reach_um"],
            axis_px=(p["axis_column"], p["axis_row"]),
            mode_light=arrays["front_sway_light"],
            mode_through=arrays["front_sway_through"],
            mode_moved=arrays.get("front_surface_moved"),
            place_px=(p.get("front_column", 0.0), p.get("front_row", 0.0)),
            far_px=p.get("front_far_px", 0.0),
        )
        sigmas = (
            p["front_focus_sigma_um"],
            p["front_core_sigma"],
        )
    return ImageComparison(
        views=views,
        looks=read_appearance(artifact),
        front=front,
        joint=read_joint(artifact),
        camera=CameraNoise(
            full_well_e=p["full_well_e"],
            read_noise_e=p["read_noise_e"],
            bits=int(p["bits"]),
            fill_factor=p["fill_factor"],
            table=None if noise is None else noise.astype(np.float64),
            floor=p.get("camera_floor", 0.0),
            ceiling=p.get("camera_ceiling", 1.0),
            misfit=p.get("misfit", 0.0),
        ),
        free=Free(
            turn=p["turns"] > 0,
            z_sigma_um=p["focus_sigma_um"],
            zoom_sigma=p["zoom_sigma"],
            gradient=p["gradient"] > 0,
            front_sigmas=sigmas,
            occluder_modes=0 if front is None else len(front.mode_light),
        ),
        symmetry=int(p["symmetry"]),
    )


def _turns_show(model: LookModel, target: Target, image: FloatArray) -> bool:
    """Return whether a rotation within the target's range changes the image."""
    turn = min(target.theta_range_rad, math.pi / max(target.symmetry, 1)) / 2
    rim_px = target.parameters.get("radius_um", 0.0) * target.px_per_um
    if turn == 0 or 4 * turn * rim_px > _MOST_ARC_PX:
        # a circle whose surroundings may lie at any angle: they are not its own
        return turn > 0 and target.kind != "circle"
    return float(np.abs(model(theta_rad=turn) - image).max()) > _LEAST_SIGNAL


def _within(target: Target) -> list[float]:
    """Return some rotations within the target's range."""
    return [share * target.theta_range_rad for share in _SHARES]


def _turning(
    model: LookModel, turns: list[float], *, dz_um: float = 0.0
) -> npt.NDArray[np.bool_]:
    """Return pixels that change with nearly all of some turns: what turns, shows."""
    image = model(dz_um=dz_um)
    change = [
        np.abs(model(theta_rad=turn, dz_um=dz_um) - image) for turn in turns if turn
    ]
    if not change:
        return np.zeros(image.shape, dtype=bool)
    kernel = np.ones((2 * _BESIDE_PX + 1, 2 * _BESIDE_PX + 1), np.uint8)
    marked = np.median(change, axis=0) > _LEAST_SIGNAL / 2
    return np.asarray(cv2.dilate(marked.astype(np.uint8), kernel) > 0)


def _odd_px(
    model: LookModel, target: Target, heights_um: tuple[float, ...]
) -> FloatArray:
    """Return pixels that a rotation by whole periods changes, (2, N) off the target's.

    At some focus heights: blur spreads what they show.
    """
    period, order = 2 * math.pi / target.symmetry, target.symmetry
    turns = [round(share * order) * period for share in _SHARES]
    changed = [_turning(model, turns, dz_um=dz) for dz in heights_um]
    rows, columns = np.nonzero(np.any(changed, axis=0))
    return np.stack((columns - round(target.column), rows - round(target.row)))


def _turned_px(places_px: FloatArray, turn_rad: float) -> FloatArray:
    """Return positions (2, N), and the template there after a rotation, (2, 2 N)."""
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    return np.concatenate((places_px, np.array([[c, -s], [s, c]]) @ places_px), axis=1)


def _cells(places_px: FloatArray, made: Artifact) -> npt.NDArray[np.float32]:
    """Return the template's cells at positions (2, N), those that are kept."""
    where, over = made.arrays["cells"], int(made.parameters["over"])
    column, row = over * places_px + [
        [(where.shape[1] - 1) // 2],
        [(where.shape[0] - 1) // 2],
    ]
    inside = (row >= 0) & (row < where.shape[0])
    inside &= (column >= 0) & (column < where.shape[1])
    flat = row[inside] * where.shape[1] + column[inside]
    kept = where.ravel()[flat.astype(np.intp)] > 0
    return np.asarray(flat[kept], dtype=np.float32)
