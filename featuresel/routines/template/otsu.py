"""Otsu's threshold with the centroid of the blob that looks like the target."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Routine,
    Target,
)
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

    Over poses between pixels, rotations and focus errors as the trials have them, each
    with the camera's noise. Light gradients are not among them.
    """
    rng = np.random.default_rng(_SEED)
    errors = []
    for dx, dy, turn, sigmas in _POSES:
        theta_rad = turn * min(target.theta_range_rad, math.pi)
        image = render(
            dx_um=dx / target.px_per_um,
            dy_um=dy / target.px_per_um,
            theta_rad=theta_rad,
            dz_um=sigmas * render.nuisances.focus_sigma_um,
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


_AREA = (0.7, 1.4)  # accepted blob area over the predicted one: blur moves the edge
_CONTRAST = 0.1  # least difference of the two classes' means, full scale
_SIDE_RAD = math.radians(30)  # a bias fixed to the part is undone below this doubt
_OFF_CENTRE_PX = 2.0  # what a seed may be off by when the angle is unknown
_FIXED_WORK, _PIXEL_WORK = 0.1, 3.4e-5  # in box filters
_SPREAD_PX = 0.5  # of a centroid that the look's own images do not show


@dataclass(frozen=True, slots=True, kw_only=True)
class _Blob:
    """One connected component."""

    column: float
    row: float
    area_px: float
    clipped: bool  # it touches the region's border


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return area, polarity, centroid off the reference point, standard deviation."""
    blobs = _blobs(render(), bright=target.bright)
    if isinstance(blobs, Failure):
        return blobs
    own = _nearest(blobs, target.column, target.row)
    reach = _radius_px(target)
    if math.hypot(own.column - target.column, own.row - target.row) > reach:
        return Failure(
            "no_blob", f"the nearest blob lies more than {reach:.1f} px off the target"
        )
    dx, dy = own.column - target.column, own.row - target.row
    turns = target.theta_range_rad > _SIDE_RAD
    if turns and math.hypot(dx, dy) > _OFF_CENTRE_PX:
        return Failure(
            "off_centre",
            f"the centroid is {math.hypot(dx, dy):.1f} px off the reference "
            "point, in a direction that turns with the part",
        )
    c, s = math.cos(target.theta_rad), math.sin(target.theta_rad)
    artifact = Artifact(
        parameters={
            "bright": float(target.bright),
            "area_px": own.area_px,
            "clipped": float(own.clipped),
            "offset_x_px": c * dx - s * dy,  # in the part's frame, y up
            "offset_y_px": -s * dx - c * dy,
            "turns": float(turns),
            "search_px": target.search_px,
        }
    )
    spread = spread_px(render, target, lambda image, at: measure(image, artifact, at))
    if spread is None:
        return artifact
    return replace(artifact, parameters={**artifact.parameters, "spread_px": spread})


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the target's position, px, in `image`, (rows, columns) 0..1.

    Fails if no blob, or more than one, fits.
    """
    p = artifact.parameters
    blobs = _blobs(image, bright=p["bright"] > 0)
    if isinstance(blobs, Failure):
        return blobs
    offset = _offset(artifact, guess)
    fitting = [blob for blob in blobs if _fits(blob, artifact, guess, offset)]
    if not fitting:
        return Failure(
            "no_blob",
            f"none of {len(blobs)} blobs has {p['area_px']:.0f} px within "
            f"{p['search_px']:.1f} px",
        )
    if len(fitting) > 1:
        return Failure("ambiguous", f"{len(fitting)} blobs fit")
    (own,) = fitting
    ratio = own.area_px / p["area_px"]
    return Measurement(
        column=own.column - offset[0],
        row=own.row - offset[1],
        score=min(ratio, 1 / ratio),
        spread_px=p.get("spread_px", _SPREAD_PX),
    )


def cost(_artifact: Artifact, pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    return _FIXED_WORK + _PIXEL_WORK * pixels


OTSU = Routine(
    name="otsu",
    version="2",
    kinds=("circle", "teeth", "outline"),
    principle="area",
    provides=("xy",),
    prepare=prepare,
    measure=measure,
    cost=cost,
)


def _offset(artifact: Artifact, guess: Guess) -> tuple[float, float]:
    """Return centroid - reference as (columns, rows); 0 where the angle is unknown."""
    p = artifact.parameters
    if p["turns"] or guess.theta_rad is None:
        return (0.0, 0.0)
    c, s = math.cos(guess.theta_rad), math.sin(guess.theta_rad)
    x, y = p["offset_x_px"], p["offset_y_px"]
    return (c * x - s * y, -s * x - c * y)


def _fits(
    blob: _Blob, artifact: Artifact, guess: Guess, offset: tuple[float, float]
) -> bool:
    """Return whether area, position and border agree with the prediction."""
    p = artifact.parameters
    away = math.hypot(
        blob.column - offset[0] - guess.column, blob.row - offset[1] - guess.row
    )
    low, high = _AREA
    return (
        low * p["area_px"] <= blob.area_px <= high * p["area_px"]
        and away <= 1.5 * p["search_px"] + 2
        and (not blob.clipped or p["clipped"] > 0)
    )


def _nearest(blobs: list[_Blob], column: float, row: float) -> _Blob:
    """Return the blob whose centroid is nearest, the larger one of equals."""
    return min(
        blobs, key=lambda b: (math.hypot(b.column - column, b.row - row), -b.area_px)
    )


def _radius_px(target: Target) -> float:
    """Return the radius within which the centroid has to lie, px."""
    p = target.parameters
    names = ("radius_um", "outer_um", "extent_um")
    return next(p[name] for name in names if name in p) * target.px_per_um


def _blobs(image: FloatArray, *, bright: bool) -> list[_Blob] | Failure:
    """Return the connected components on the target's side of Otsu's threshold."""
    low, high = float(image.min()), float(image.max())
    if high - low < _CONTRAST:
        return Failure(
            "no_contrast", f"values span {high - low:.3f}, at least {_CONTRAST}"
        )
    grey = np.rint((image - low) * (255 / (high - low))).astype(np.uint8)
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0)  # single noisy pixels are no blobs
    level, _ = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    above = smooth > level
    gap = float(image[above].mean() - image[~above].mean())
    if gap < _CONTRAST:
        return Failure(
            "no_contrast", f"classes differ by {gap:.3f}, at least {_CONTRAST}"
        )
    return _components((above == bright).astype(np.uint8))


def _components(mask: npt.NDArray[np.uint8]) -> list[_Blob] | Failure:
    """Return the components of at least 9 pixels."""
    _, _, stats, centroids = cv2.connectedComponentsWithStats(mask, connectivity=4)
    rows, columns = mask.shape
    found = []
    for (left, top, width, height, area), (x, y) in zip(
        stats[1:].tolist(), centroids[1:].tolist(), strict=True
    ):
        clipped = left == 0 or top == 0 or left + width == columns
        clipped = clipped or top + height == rows
        if area >= 9:
            found.append(_Blob(column=x, row=y, area_px=float(area), clipped=clipped))
    if not found:
        return Failure("no_blob", "no component of 9 pixels or more")
    return found
