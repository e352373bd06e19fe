"""Enhanced correlation coefficient: a rendered template shifted and turned to fit.

All of the target's pixels count, so a part out of focus is located about as well as its
image allows; in focus, where pixels undersample the edges, bilinear sampling costs more
than noise does. It knows no zoom: a reference point far from the middle of what is seen
moves with it. `benchmarks/localisation` has the numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from featuresel.routines import (
    Artifact,
    Failure,
    FloatArray,
    Guess,
    Known,
    Measurement,
    Render,
    Target,
    TargetKind,
)
from featuresel.routines.extent import cut, half_px
from featuresel.routines.peak import Float32Array
from featuresel.routines.picture import refused

NAME = "ecc"
VERSION = "1"
KINDS: tuple[TargetKind, ...] = ("circle", "teeth", "outline", "jaws")
GIVES: tuple[Known, ...] = ("xy", "theta")
NEEDS: tuple[Known, ...] = ("xy", "theta")
CAPTURE_PX = 3.0
CONTROL = False
DEAR = False

_LEAST_SCORE = 0.8  # correlation; blur and light gradients leave .9 and more
_MOVED_PX = 2 * CAPTURE_PX  # from the guess: beyond, it has run away
_TURNED_RAD = 0.2  # likewise
_LAST_PX = 0.1  # the step after convergence: a larger one is no convergence
_ROUNDS, _SETTLED = 20, 1e-6  # of the correlation
_NO_BLUR = 1  # OpenCV blurs both images by 5 px otherwise, which shifts what is found
_QUARTER_RAD = math.pi / 2
_GRID = 32  # OpenCV's warp rounds coordinates to this part of a pixel
_TYPICAL_ROUNDS = 7
_TURN_WORK, _SHIFT_WORK = 4.2e-5, 4.5e-5  # a round, per pixel, in box filters
_PART_WORK = 2e-5  # per pixel of the part: copies and gradients
_FAINT = 0.01  # standard deviation below which a template shows nothing
# Of what the rim tells when shifted, the least it tells when turned. Pixels alone make
# a disc in focus seem to tell .01.
_TURN_TOLD, _TURN_TOLD_ROUND = 0.002, 0.02
_PLACES_PX = ((0.0, 0.5), (0.25, 0.0), (0.5, 0.75), (0.75, 0.25))  # all phases differ
_TURNS = (-1.0, -0.3, 0.3, 1.0)  # of the angle's range


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pose:
    """Where the template's middle pixel is, px, and how far it is turned."""

    column: float
    row: float
    turned_rad: float
    score: float


def prepare(render: Render, target: Target) -> Artifact | Failure:
    """Return the nominal template, and how much it tells of place and angle.

    The angle is not sought where nothing shows it. What bilinear sampling makes of
    sub-pixel places is measured on the render and goes into the spread.
    """
    image = render()
    half = half_px(target, image.shape, CAPTURE_PX)
    if min(half) < 4:
        return Failure(
            code="outside", message=f"{min(half)} px between target and border"
        )
    template = cut(image, target, half)
    if not float(template.std()) > _FAINT:
        return Failure(code="no_contrast", message="the template is blank")
    first = Artifact(
        parameters={
            "offset_column_px": target.column - round(target.column),
            "offset_row_px": target.row - round(target.row),
            "theta_rad": target.theta_rad,
            "locked_px": 0.0,
            **_told(template, round_target=target.kind == "circle"),
        },
        arrays={"template": template.astype(np.float32)},
    )
    locked = _locked_px(render, target, first)
    if isinstance(locked, Failure):
        return locked
    parameters = {**first.parameters, "locked_px": locked}
    return Artifact(parameters=parameters, arrays=first.arrays)


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return place and angle; fails if the guess is far off or the images differ."""
    if unfit := refused(image):
        return unfit
    p = artifact.parameters
    if p["turns"] and guess.theta_rad is None:
        return Failure(code="no_angle", message="needs an angle to start from")
    start = _start(artifact, guess)
    found = _align(image, artifact, start)
    if isinstance(found, Failure):
        return found
    moved = math.hypot(found.column - start.column, found.row - start.row)
    turned = abs(found.turned_rad - start.turned_rad)
    if moved > _MOVED_PX or turned > _TURNED_RAD:
        return Failure(
            code="diverged",
            message=f"moved by {moved:.2f} px and {turned:.3f} rad from the guess",
        )
    if found.score < _LEAST_SCORE:
        return Failure(
            code="low_score",
            message=f"correlation {found.score:.3f}, at least {_LEAST_SCORE}",
        )
    return _measurement(found, artifact)


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `featuresel.routines.Routine`."""
    template = artifact.arrays["template"]
    part = (math.hypot(*template.shape) + 2 * _MOVED_PX) ** 2
    each = _TURN_WORK if artifact.parameters["turns"] else _SHIFT_WORK
    return 0.5 + _PART_WORK * part + _TYPICAL_ROUNDS * each * template.size


def _told(template: FloatArray, *, round_target: bool) -> dict[str, float]:
    """Return squared slopes over the variance: what a step does to the correlation."""
    down, across = np.gradient(template)
    v = np.arange(template.shape[0])[:, None] - (template.shape[0] - 1) / 2
    u = np.arange(template.shape[1]) - (template.shape[1] - 1) / 2
    turn = across * v - down * u
    variance = float(template.var())
    x, y, t = (float((slope**2).sum()) / variance for slope in (across, down, turn))
    least = _TURN_TOLD_ROUND if round_target else _TURN_TOLD
    rim = float(((across**2 + down**2) * (u**2 + v**2)).sum()) / variance
    return {
        "x_per_px2": x,
        "y_per_px2": y,
        "turn_per_rad2": t,
        "turns": float(t > least * rim),
    }


def _locked_px(render: Render, target: Target, artifact: Artifact) -> float | Failure:
    """Return the rms error per axis without noise, over some places and turns.

    Turned edges cross pixels at all phases: it is largest where nothing turns.
    """
    um_per_px, errors = 1 / target.px_per_um, []
    most = min(target.theta_range_rad, _TURNED_RAD) * artifact.parameters["turns"]
    for (dx, dy), part in zip(_PLACES_PX, _TURNS, strict=True):
        turn = part * most
        image = render(dx_um=dx * um_per_px, dy_um=dy * um_per_px, theta_rad=turn)
        column, row = target.column + dx, target.row - dy
        at = Guess(column=column, row=row, theta_rad=target.theta_rad + turn)
        found = measure(image, artifact, at)
        if isinstance(found, Failure):
            return found
        errors.append((found.column - column, found.row - row))
    return float(np.sqrt(np.mean(np.square(errors))))


def _start(artifact: Artifact, guess: Guess) -> _Pose:
    """Return the template's pose that the guess stands for."""
    p = artifact.parameters
    turned = 0.0
    if p["turns"] and guess.theta_rad is not None:
        turned = math.remainder(guess.theta_rad - p["theta_rad"], math.tau)
    dx, dy = _turned((p["offset_column_px"], p["offset_row_px"]), turned)
    return _Pose(
        column=guess.column - dx, row=guess.row - dy, turned_rad=turned, score=0.0
    )


def _align(image: FloatArray, artifact: Artifact, start: _Pose) -> _Pose | Failure:
    """Return the pose of the highest correlation.

    OpenCV takes the angle from its sine, so the template is turned by quarters first,
    which moves pixels onto pixels. Its warp rounds coordinates to 1/32 px and then
    steps as if it had not, so one last step starts on that grid, where rounding
    changes nothing.
    """
    quarters = round(start.turned_rad / _QUARTER_RAD)
    template = np.ascontiguousarray(np.rot90(artifact.arrays["template"], quarters))
    left, top, part = _part(image, template.shape, start)
    if min(part.shape) < 4:
        return Failure(code="outside", message="the target is out of view")
    if not float(part.std()) > _FAINT / 2:
        return Failure(code="no_contrast", message="the image is blank")
    at = _Pose(
        column=start.column - left,
        row=start.row - top,
        turned_rad=start.turned_rad - quarters * _QUARTER_RAD,
        score=0.0,
    )
    turns = artifact.parameters["turns"] > 0
    found = _search(part, template, at, _ROUNDS, turns=turns)
    if isinstance(found, Failure):
        return found
    on_grid = replace(
        found,
        column=round(found.column * _GRID) / _GRID,
        row=round(found.row * _GRID) / _GRID,
    )
    last = _search(part, template, on_grid, 1, turns=turns)
    if isinstance(last, Failure):
        return last
    step = math.hypot(last.column - on_grid.column, last.row - on_grid.row)
    if not step <= _LAST_PX:
        return Failure(code="diverged", message=f"still moves by {step:.3f} px")
    return replace(
        last,
        column=last.column + left,
        row=last.row + top,
        turned_rad=last.turned_rad + quarters * _QUARTER_RAD,
    )


def _part(
    image: FloatArray, shape: tuple[int, ...], at: _Pose
) -> tuple[int, int, Float32Array]:
    """Return left, top and the piece of the image that the template may reach."""
    reach = math.hypot(*shape) / 2 + _MOVED_PX
    left, top = max(0, int(at.column - reach)), max(0, int(at.row - reach))
    right, bottom = max(0, int(at.column + reach)), max(0, int(at.row + reach))
    part = image[top : bottom + 1, left : right + 1]
    return left, top, np.ascontiguousarray(part, dtype=np.float32)


def _search(
    image: Float32Array,
    template: Float32Array,
    start: _Pose,
    rounds: int,
    *,
    turns: bool,
) -> _Pose | Failure:
    """Return the pose after `rounds` of OpenCV's steps at most.

    References
    ----------
    Evangelidis & Psarakis (2008).
    """
    motion = cv2.MOTION_EUCLIDEAN if turns else cv2.MOTION_TRANSLATION
    middle = ((template.shape[1] - 1) / 2, (template.shape[0] - 1) / 2)
    limits = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, rounds, _SETTLED)
    everywhere = np.ones(image.shape, dtype=np.uint8)
    try:
        score, warp = cv2.findTransformECC(
            template,
            image,
            _warp(start, middle),
            motion,
            limits,
            everywhere,
            _NO_BLUR,
        )
    except cv2.error as error:
        return Failure(code="diverged", message=f"no convergence: {error.err}")
    if not (math.isfinite(score) and np.isfinite(warp).all()):
        return Failure(code="diverged", message="no finite pose")
    m = warp.astype(np.float64)
    column, row = m @ (*middle, 1.0)
    return _Pose(
        column=float(column),
        row=float(row),
        turned_rad=math.atan2(-m[1, 0], m[0, 0]),
        score=float(score),
    )


def _warp(pose: _Pose, middle: tuple[float, float]) -> Float32Array:
    """Return the map (2, 3) from the template's pixels to the image's."""
    c, s = math.cos(pose.turned_rad), math.sin(pose.turned_rad)
    x, y = _turned(middle, pose.turned_rad)
    return np.array(((c, s, pose.column - x), (-s, c, pose.row - y)), dtype=np.float32)


def _measurement(found: _Pose, artifact: Artifact) -> Measurement:
    """Return the reference point's pose from the template's.

    The residual's share of the contrast is 1 / score^2 - 1; what the slopes make of it
    is the spread.
    """
    p = artifact.parameters
    dx, dy = _turned((p["offset_column_px"], p["offset_row_px"]), found.turned_rad)
    score = min(max(found.score, 1e-6), 1.0)
    residual = math.sqrt(1 / score**2 - 1)
    scatter = residual / math.sqrt(min(p["x_per_px2"], p["y_per_px2"]))
    theta = spread_theta = None
    if p["turns"]:
        theta = math.remainder(p["theta_rad"] + found.turned_rad, math.tau)
        spread_theta = residual / math.sqrt(p["turn_per_rad2"])
    return Measurement(
        column=found.column + dx,
        row=found.row + dy,
        theta_rad=theta,
        score=score,
        spread_px=math.hypot(scatter, p["locked_px"]),
        spread_theta_rad=spread_theta,
    )


def _turned(point: tuple[float, float], turned_rad: float) -> tuple[float, float]:
    """Return (columns, rows) turned counter-clockwise as displayed: rows go down."""
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    return c * point[0] + s * point[1], -s * point[0] + c * point[1]
