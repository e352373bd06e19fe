"""Normalised cross-correlation with rendered templates."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from microplan.arrays import Float32Array, FloatArray
from microplan.featuresel.routines import work
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Routine,
    Target,
    scale_limit,
)
from microplan.featuresel.routines.picture import cut, half_px
from microplan.featuresel.routines.template.template_fit import (
    SURE_SCORE,
    refine,
    refine_work,
)

_LEAST_SCORE = 0.6  # correlation; noise, blur and gradients leave .8 and more
_COARSE_PX = 16.0  # half the template's side where angles are searched
_STEP_PX = 1.0  # of the rim between two templates: half of it blurs, no more
_MOST = 96  # templates
_NO_TURN_RAD = 1e-3  # below this range the angle is not searched


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return templates over the angles, and whether the angle is measured.

    The angle of an outline or of fingers is searched in small images and refined by a
    least-squares fit of the nominal template, its scale free: zoom moves the fingers'
    tips, and they would take the grip along. For round and toothed parts the templates
    only have to be near, over one period of the symmetry.
    """
    image = render()
    half = half_px(target, image.shape, target.search_px)
    if min(half) < 4:
        return Failure(
            "outside", f"{min(half)} px between target and border after the search"
        )
    some = target.theta_range_rad > _NO_TURN_RAD
    turns = target.kind == "jaws" or (target.kind == "outline" and some)
    shrink = 1
    if turns:  # a power of two, so that halving ends at 1
        shrink = 2 ** max(0, int(math.log2(max(1.0, min(half) / _COARSE_PX))))
    turned = _angles(target, half, shrink)
    templates = [
        _shrunk(cut(render(theta_rad=t), target, half), shrink) for t in turned
    ]
    if min(float(t.std()) for t in templates) < 0.01:
        return Failure("no_contrast", "the template is blank")
    return Artifact(
        parameters={
            "half_columns_px": float(half[0]),
            "half_rows_px": float(half[1]),
            "offset_column_px": target.column - round(target.column),
            "offset_row_px": target.row - round(target.row),
            "search_px": target.search_px,
            "shrink": float(shrink),
            "turns": float(turns),
            "theta_rad": target.theta_rad,
            "range_rad": target.theta_range_rad,
            "least_score": SURE_SCORE if target.kind == "jaws" else _LEAST_SCORE,
            "scale_off": scale_limit(target, render.nuisances.zoom_sigma),
        },
        arrays={
            "templates": np.stack(templates).astype(np.float32),
            "turned_rad": turned.astype(np.float32),
            "nominal": cut(image, target, half).astype(np.float32),
        },
    )


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the best match's position, px, in `image`, (rows, columns) 0..1.

    Its angle too, where that is searched.
    """
    p = artifact.parameters
    shrink = int(p["shrink"])
    matched = _match(_shrunk(image, shrink), artifact, guess)
    if isinstance(matched, Failure):
        return matched
    column, row, turned_rad, score = matched
    if not p["turns"]:
        return _answer(artifact, column, row, None, score)
    fine = refine(
        image,
        artifact.arrays["nominal"].astype(np.float64),
        (column, row, turned_rad),
        shrink,
        least_score=p["least_score"],
        scale_off=p["scale_off"],
    )
    if isinstance(fine, Failure):
        return fine
    moved = math.hypot(fine.column - column, fine.row - row)
    if moved > 2 * shrink + 2:
        return Failure("diverged", f"the fit moved by {moved:.1f} px")
    if abs(fine.turned_rad) > p["range_rad"] * 1.2 + 0.01 and p["range_rad"] < 3:
        return Failure("outside", f"turned by {fine.turned_rad:.3f} rad")
    theta = math.remainder(p["theta_rad"] + fine.turned_rad, 2 * math.pi)
    return _answer(
        artifact, fine.column, fine.row, theta, fine.score, turned=fine.turned_rad
    )


def cost(artifact: Artifact, pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    p, templates = artifact.parameters, artifact.arrays["templates"]
    shrink = int(p["shrink"])
    reach = 2 * (p["search_px"] / shrink + 2)
    part = (templates.shape[1] + reach) * (templates.shape[2] + reach)
    total = work.CALLS + len(templates) * work.correlate(part)
    if shrink > 1:
        total += work.smooth(pixels, 0.45 * shrink)
    if p["turns"]:
        nominal = artifact.arrays["nominal"].astype(np.float64)
        total += refine_work(nominal, pixels, shrink)
    return total


NCC = Routine(
    name="ncc",
    version="3",
    kinds=("circle", "teeth", "outline", "jaws"),
    principle="area",
    provides=("xy", "theta"),
    prepare=prepare,
    measure=measure,
    cost=cost,
)


def _answer(
    artifact: Artifact,
    column: float,
    row: float,
    theta_rad: float | None,
    score: float,
    *,
    turned: float = 0.0,
) -> Measurement:
    """Return the position of the reference point by that of the template's middle."""
    p = artifact.parameters
    dx, dy = p["offset_column_px"], p["offset_row_px"]
    c, s = math.cos(turned), math.sin(turned)  # rows go down: the turn is mirrored
    return Measurement(
        column=column + c * dx + s * dy,
        row=row - s * dx + c * dy,
        theta_rad=theta_rad,
        score=min(score, 1.0),
        spread_px=0.02 + 0.5 * math.sqrt(max(1 - score, 0.0) / p["half_rows_px"]),
    )


def _angles(target: Target, half: tuple[int, int], shrink: int) -> FloatArray:
    """Return rotations away from nominal so close that the rim moves by `_STEP_PX`."""
    if target.kind == "circle":
        return np.zeros(1)
    limit = min(target.theta_range_rad, math.pi / max(target.symmetry, 1))
    if limit <= _NO_TURN_RAD:
        return np.zeros(1)
    steps = math.ceil(2 * limit * max(half) / shrink / _STEP_PX)
    return np.linspace(-limit, limit, min(max(steps | 1, 3), _MOST))


def _shrunk(image: FloatArray, shrink: int) -> FloatArray:
    """Return the image `shrink` times smaller; sample (0, 0) stays where it was."""
    if shrink == 1:
        return image
    smooth = cv2.GaussianBlur(image, (0, 0), 0.45 * shrink)
    return np.asarray(smooth[::shrink, ::shrink], dtype=np.float64)


def _match(
    small: FloatArray, artifact: Artifact, guess: Guess
) -> tuple[float, float, float, float] | Failure:
    """Return (column, row, rotation, score) of the best match, px of the full image."""
    p, templates = artifact.parameters, artifact.arrays["templates"]
    shrink = p["shrink"]
    part = _part(small, artifact, guess, templates.shape[1:])
    if part is None:
        return Failure("outside", "the search leaves the region")
    left, top, searched = part
    if float(searched.std()) < 0.005:
        return Failure("no_contrast", "the searched part is blank")
    maps = [_scores(searched, template) for template in templates]
    best = max(range(len(maps)), key=lambda i: float(maps[i].max()))
    surface = maps[best]
    if float(surface.max()) < _LEAST_SCORE:
        return _low(float(surface.max()))
    peak = find_peak(surface)
    if isinstance(peak, Failure):
        return peak
    turned = float(artifact.arrays["turned_rad"][best])
    column = (left + peak[0]) * shrink + p["half_columns_px"]
    row = (top + peak[1]) * shrink + p["half_rows_px"]
    return column, row, turned, float(surface.max())


def _scores(searched: Float32Array, template: npt.NDArray[np.float32]) -> Float32Array:
    """Return the correlation coefficient at every position of the template."""
    scores = cv2.matchTemplate(searched, template, cv2.TM_CCOEFF_NORMED)
    return np.asarray(scores, dtype=np.float32)


def _part(
    small: FloatArray, artifact: Artifact, guess: Guess, size: tuple[int, ...]
) -> tuple[int, int, Float32Array] | None:
    """Return the part of the image to search, with its left and top pixel."""
    p, shrink = artifact.parameters, artifact.parameters["shrink"]
    reach = p["search_px"] / shrink + 2
    x = (guess.column - p["offset_column_px"] - p["half_columns_px"]) / shrink
    y = (guess.row - p["offset_row_px"] - p["half_rows_px"]) / shrink
    left, top = max(0, int(x - reach)), max(0, int(y - reach))
    right = min(small.shape[1] - size[1], math.ceil(x + reach))
    bottom = min(small.shape[0] - size[0], math.ceil(y + reach))
    if right - left < 2 or bottom - top < 2:
        return None
    part = small[top : bottom + size[0], left : right + size[1]]
    return left, top, np.ascontiguousarray(part, dtype=np.float32)


def _low(score: float) -> Failure:
    """Return the failure of a poor match."""
    return Failure("low_score", f"correlation {score:.3f}, at least {_LEAST_SCORE}")


_RIVAL = 0.95  # of the best score, the most a peak elsewhere may reach


def find_peak(surface: Float32Array) -> tuple[float, float] | Failure:
    """Return the peak (column, row), px, of a (rows, columns) map of scores."""
    row, column = divmod(int(surface.argmax()), surface.shape[1])
    rows, columns = surface.shape
    if not (0 < row < rows - 1 and 0 < column < columns - 1):
        return Failure("outside", "the best match is at the search's rim")
    rival = _rival(surface, column, row)
    if rival > _RIVAL * float(surface[row, column]):
        return Failure(
            "ambiguous",
            f"scores {surface[row, column]:.3f} and {rival:.3f} at two places",
        )
    near = surface[row - 1 : row + 2, column - 1 : column + 2].astype(np.float64)
    dx = (near[:, 2] - near[:, 0]).sum() / 6
    dy = (near[2] - near[0]).sum() / 6
    xx = (near[:, 0] - 2 * near[:, 1] + near[:, 2]).sum() / 3
    yy = (near[0] - 2 * near[1] + near[2]).sum() / 3
    xy = (near[0, 0] + near[2, 2] - near[0, 2] - near[2, 0]) / 4
    determinant = xx * yy - xy * xy
    if not (determinant > 0 and xx < 0):
        return Failure("no_peak", "the scores have no maximum")
    u, v = (xy * dy - yy * dx) / determinant, (xy * dx - xx * dy) / determinant
    return column + float(np.clip(u, -1, 1)), row + float(np.clip(v, -1, 1))


def _rival(surface: Float32Array, column: int, row: int) -> float:
    """Return the highest local maximum that is not the peak's own hill, else -1."""
    lifted = cv2.dilate(surface, np.ones((5, 5), np.uint8))
    tops = surface >= lifted
    tops[max(row - 3, 0) : row + 4, max(column - 3, 0) : column + 4] = False
    return float(surface[tops].max()) if tops.any() else -1.0
