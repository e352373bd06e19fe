"""Enhanced correlation coefficient: a rendered template shifted and turned to fit.

All of the target's pixels count, so a part out of focus is located about as well as its
image allows; in focus, where pixels undersample the edges, bilinear sampling costs more
than noise does. Zoom is no part of it: where the edges lie to one side of the reference
point, as fingers' tips do of their grip, a wrong zoom would move what is found, so
there a fit with a free scale follows. `benchmarks/localisation` has the numbers.
"""

from __future__ import annotations

import math

import numpy as np

from microplan.arrays import FloatArray
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
from microplan.featuresel.routines.template.ecc_search import (
    FAINT,
    REACH_PX,
    TemplatePose,
    align,
    turned,
)
from microplan.featuresel.routines.template.template_fit import (
    SURE_SCORE,
    refine,
    refine_work,
)

_CAPTURE_PX = 3.0

_LEAST_SCORE = 0.8  # correlation; blur and light gradients leave .9 and more
_TURNED_RAD = 0.2  # from the guess: beyond, it has run away
_ZOOM_SIGMAS = 3.0  # of zoom errors that a scale has to take
_PULLED_PX = 0.1  # by those: round and toothed parts stay far below, fingers far above
_SHRINK = 2  # of the first images of the fit: twice as far to fall into place
_TYPICAL_ROUNDS = 7
_TURN_WORK, _SHIFT_WORK = 4.2e-5, 4.5e-5  # a round, per pixel, in box filters
_PART_WORK = 2e-5  # per pixel of the part: copies and gradients
# Of what the rim tells when shifted, the least it tells when turned. Pixels alone make
# a disc in focus seem to tell .01.
_TURN_TOLD, _TURN_TOLD_ROUND = 0.002, 0.02
_PLACES_PX = ((0.0, 0.5), (0.25, 0.0), (0.5, 0.75), (0.75, 0.25))  # all phases differ
_TURNS = (-1.0, -0.3, 0.3, 1.0)  # of the angle's range


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return the nominal template, and its information about position and angle.

    The angle is not sought where nothing shows it, the scale not where it moves
    nothing. What bilinear sampling makes of sub-pixel positions is measured on the
    render and goes into the standard deviation.
    """
    image = render()
    half = half_px(target, image.shape, _CAPTURE_PX)
    if min(half) < 4:
        return Failure("outside", f"{min(half)} px between target and border")
    template = cut(image, target, half)
    if not float(template.std()) > FAINT:
        return Failure("no_contrast", "the template is blank")
    zoom = _ZOOM_SIGMAS * render.nuisances.zoom_sigma
    alone = cut(render.alone(), target, half)  # the static scene pulls in any case
    first = Artifact(
        parameters={
            "offset_column_px": target.column - round(target.column),
            "offset_row_px": target.row - round(target.row),
            "theta_rad": target.theta_rad,
            "locked_px": 0.0,
            "scales": float(zoom * _pulled_px(alone) > _PULLED_PX),
            "scale_off": scale_limit(target, render.nuisances.zoom_sigma),
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
    """Return position, px, and angle in `image`, (rows, columns) 0..1.

    Fails if the guess is far off or the images differ.
    """
    p = artifact.parameters
    if p["turns"] and guess.theta_rad is None:
        return Failure("no_angle", "needs an angle to start from")
    start = _start(artifact, guess)
    found = align(image, artifact.arrays["template"], start, turns=p["turns"] > 0)
    if p["scales"] and not isinstance(found, Failure):
        found = _scaled(image, artifact, found)
    if isinstance(found, Failure):
        return found
    return _strayed(start, found) or _measurement(found, artifact)


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    template = artifact.arrays["template"]
    part = (math.hypot(*template.shape) + 2 * REACH_PX) ** 2
    each = _TURN_WORK if artifact.parameters["turns"] else _SHIFT_WORK
    work = 0.5 + _PART_WORK * part + _TYPICAL_ROUNDS * each * template.size
    if artifact.parameters["scales"]:
        work += refine_work(template.astype(np.float64), part, _SHRINK)
    return work


ECC = Routine(
    name="ecc",
    version="3",
    kinds=("circle", "teeth", "outline", "jaws"),
    principle="area",
    provides=("xy", "theta"),
    requires=("xy", "theta"),
    capture_px=_CAPTURE_PX,
    prepare=prepare,
    measure=measure,
    cost=cost,
)


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


def _pulled_px(template: FloatArray) -> float:
    """Return how far a scale of 2 would move what is found, to first order.

    A template scaled about its middle looks shifted where its edges lie to one side.
    """
    down, across = np.gradient(template)
    v = np.arange(template.shape[0])[:, None] - (template.shape[0] - 1) / 2
    u = np.arange(template.shape[1]) - (template.shape[1] - 1) / 2
    grown = across * u + down * v
    x = float((grown * across).sum()) / max(float((across**2).sum()), 1e-12)
    y = float((grown * down).sum()) / max(float((down**2).sum()), 1e-12)
    return math.hypot(x, y)


def _locked_px(
    render: LookModel, target: Target, artifact: Artifact
) -> float | Failure:
    """Return the rms error per axis without noise, over some positions and rotations.

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


def _scaled(
    image: FloatArray, artifact: Artifact, near: TemplatePose
) -> TemplatePose | Failure:
    """Return the pose with the scale free, from one found without."""
    found = refine(
        image,
        artifact.arrays["template"].astype(np.float64),
        (near.column, near.row, near.turned_rad),
        _SHRINK,
        least_score=SURE_SCORE,
        scale_off=artifact.parameters["scale_off"],
        turns=artifact.parameters["turns"] > 0,
    )
    if isinstance(found, Failure):
        return found
    return TemplatePose(
        column=found.column,
        row=found.row,
        turned_rad=found.turned_rad,
        score=found.score,
    )


def _strayed(start: TemplatePose, found: TemplatePose) -> Failure | None:
    """Return why what was found cannot be the target, if it cannot."""
    moved = math.hypot(found.column - start.column, found.row - start.row)
    turned_rad = abs(found.turned_rad - start.turned_rad)
    if moved > REACH_PX or turned_rad > _TURNED_RAD:
        return Failure(
            "diverged",
            f"moved by {moved:.2f} px and {turned_rad:.3f} rad from the guess",
        )
    if found.score < _LEAST_SCORE:
        return Failure(
            "low_score", f"correlation {found.score:.3f}, at least {_LEAST_SCORE}"
        )
    return None


def _start(artifact: Artifact, guess: Guess) -> TemplatePose:
    """Return the template's pose that the guess stands for."""
    p = artifact.parameters
    turn = 0.0
    if p["turns"] and guess.theta_rad is not None:
        turn = math.remainder(guess.theta_rad - p["theta_rad"], math.tau)
    dx, dy = turned((p["offset_column_px"], p["offset_row_px"]), turn)
    return TemplatePose(
        column=guess.column - dx, row=guess.row - dy, turned_rad=turn, score=0.0
    )


def _measurement(found: TemplatePose, artifact: Artifact) -> Measurement:
    """Return the reference point's pose from the template's.

    The residual's share of the contrast is 1 / score^2 - 1; what the slopes make of it
    is the standard deviation.
    """
    p = artifact.parameters
    dx, dy = turned((p["offset_column_px"], p["offset_row_px"]), found.turned_rad)
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
