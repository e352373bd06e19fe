"""Contour matching from the drawing, with the polarity of each edge predicted."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contour.calibrate import (
    SHRINKS,
    Views,
    calibrated,
    coarsest,
    floor,
)
from microplan.featuresel.routines.contour.fit import ContourFit, Lines, fit, fit_work
from microplan.featuresel.routines.contour.model import (
    ROUND,
    ContourModel,
    build,
    rim_px,
)
from microplan.featuresel.routines.contour.polarity import predict
from microplan.featuresel.routines.contour.search import (
    Field,
    ScoredPose,
    climb,
    climb_work,
    field,
    field_work,
    gradient_noise,
    scan,
    score,
    search,
    search_work,
)
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

_FAINT_SCORE = 0.1  # of gradients, where the search ends: light and blur take the rest
_LEAST_SCORE = 0.5  # of their directions, at the end: noise and blur leave .7 and more
_RIVAL = 0.9  # of the best score, the most another pose may reach
_VALLEY = 0.97  # of the lower score: what lies higher all the way is one hill
_FEWEST = 12  # points to match
_BREAKING = 3  # points that distinguish turns, at least
_NO_TURN_RAD = 1e-3  # below this range the angle is not searched
_NOISES = 3.0  # standard deviations of noise below which a gradient has no direction
_RUNNER_UP = 0.6  # of the best turn's score, the most the second may reach
_LEAST = 0.35  # of the whole contour's score: where nothing is, it is 0
_SAME_PX = 3.0  # of the farthest edge: turns by less are not rivals
_TURN = 0.03  # work of trying one turn of the symmetry


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return the points to match, what breaks their symmetry, and where edges are."""
    image = render()
    seen = predict(render, target, image=image)
    model = build(target, seen)
    count = len(model.points)
    if count < _FEWEST:
        return Failure(
            "no_edge", f"{count} edge points can be relied on, at least {_FEWEST}"
        )
    at = ScoredPose(
        column=target.column, row=target.row, theta_rad=target.theta_rad, score=1.0
    )
    floors = {s: floor(image, model.points, at, s) for s in SHRINKS}
    turns = _turns(model, target)
    views = Views(render=render, target=target, model=model, tells_turn=turns)
    found = calibrated(views, seen, image)
    if found is None:
        return Failure("no_fit", "the nominal edges make no fit")
    lines, bias = found
    sigma = math.sqrt(float(render.camera.variance(image).max()))
    return Artifact(
        parameters={
            "order": float(model.order),
            "shrink": float(coarsest(image, model.points, at, floors)),
            "width_px": lines.width_px,
            "bias_px": bias[0],
            "bias_rad": bias[1],
            "noise": _NOISES * sigma * gradient_noise(),
            "zoom_sigma": render.nuisances.zoom_sigma,
            "scale_off": scale_limit(target, render.nuisances.zoom_sigma),
            "search_px": target.search_px,
            "theta_rad": target.theta_rad,
            "range_rad": target.theta_range_rad,
            "turns": float(turns),
            **{f"floor_{s}": least for s, least in floors.items()},
        },
        arrays={
            "points": model.points.astype(np.float32),
            "step": lines.step.astype(np.float32),
            "offset_px": lines.offset_px.astype(np.float32),
            "breaking": model.breaking.astype(np.float32),
        },
    )


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return position, px, and angle in `image`, (rows, columns) 0..1.

    Fails if the match is poor, ambiguous or out of view. The angle is None if the
    contour is round, or if no edge in sight distinguishes the rotations of its
    symmetry.
    """
    if min(image.shape) < 4 * artifact.parameters["shrink"]:
        return Failure("outside", f"an image of {image.shape} px")
    points = artifact.arrays["points"].astype(np.float64)
    pose = _matched(image, artifact, points, guess)
    if isinstance(pose, Failure):
        return pose
    fitted = fit(image, _lines(artifact, points), pose)
    if isinstance(fitted, Failure):
        return fitted
    if problem := _misplaced(fitted, artifact, guess, pose):
        return problem
    return _answer(image, artifact, points, fitted)


def cost(artifact: Artifact, pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    p = artifact.parameters
    points = artifact.arrays["points"].astype(np.float64)
    levels = [s for s in SHRINKS if s <= p["shrink"]]
    angles = len(_angles(p, points))
    shifts = 2 * math.ceil((p["search_px"] + 1) / p["shrink"]) + 1
    total = search_work(len(points), angles, shifts**2)
    total += (len(levels) - 1) * climb_work(len(points), turns=angles > 1)
    total += sum(field_work(pixels / s**2) for s in levels) + field_work(pixels)
    if p["turns"] and p["order"] != 1:
        breaking = float(artifact.arrays["breaking"].sum())
        turned = p["order"] or 4 * math.pi * rim_px(points)
        total += turned * (_TURN + search_work(breaking, 1, 1))
    return total + fit_work(_lines(artifact, points))


CONTOUR_MATCH = Routine(
    name="contour_match",
    version="2",
    kinds=("circle", "teeth", "outline", "jaws"),
    principle="edges",
    provides=("xy", "theta"),
    prepare=prepare,
    measure=measure,
    cost=cost,
)


def _turns(model: ContourModel, target: Target) -> bool:
    """Return whether the angle is observable."""
    if model.order == 1:
        return True
    if int(model.breaking.sum()) >= _BREAKING:
        return True
    return model.order != ROUND and target.theta_range_rad < math.pi / model.order


def _lines(artifact: Artifact, points: FloatArray) -> Lines:
    """Return what the fit needs."""
    p, arrays = artifact.parameters, artifact.arrays
    breaks = p["order"] == ROUND and not p["turns"]
    return Lines(
        points=points,
        step=arrays["step"].astype(np.float64),
        offset_px=arrays["offset_px"].astype(np.float64),
        width_px=p["width_px"],
        zoom_sigma=p["zoom_sigma"],
        turns=not breaks,
    )


def _angles(p: Mapping[str, float], points: FloatArray) -> FloatArray:
    """Return the angles to search: one period at most, a sample apart at the rim."""
    limit, order = p["range_rad"], int(p["order"])
    if order == ROUND or limit <= _NO_TURN_RAD:
        return np.array((p["theta_rad"],))
    limit = min(limit, math.pi / order)
    rim = rim_px(points)
    count = max(math.ceil(2 * limit * rim / p["shrink"]), 2)
    # an open range has an angle at either end, a closed one need not
    steps = np.arange(count + (0 if limit == math.pi / order else 1))
    angles = p["theta_rad"] - limit + 2 * limit / count * steps
    return np.asarray(angles, dtype=np.float64)


def _matched(
    image: FloatArray, artifact: Artifact, points: FloatArray, guess: Guess
) -> ScoredPose | Failure:
    """Return the best pose to about a pixel, at the rotation that the edges confirm."""
    p = artifact.parameters
    shrink = int(p["shrink"])
    angles = _angles(p, points)
    closed = p["order"] >= 1 and p["range_rad"] >= math.pi / p["order"]
    found = field(image, shrink, p[f"floor_{shrink}"])
    near = (guess.column, guess.row)
    poses = search(found, points, near, p["search_px"] + 1, angles, closed=closed)
    step = float(angles[1] - angles[0]) if len(angles) > 1 else 0.0
    while shrink > 1:
        shrink //= 2
        step /= 2
        found = field(image, shrink, p[f"floor_{shrink}"])
        poses = tuple(climb(found, points, one, step, turns=step > 0) for one in poses)
    ranked = sorted(poses, key=lambda one: -one.score)
    best = ranked[0]
    if best.score < _FAINT_SCORE:
        return _low(best.score, _FAINT_SCORE)
    for other in ranked[1:]:
        if other.score > _RIVAL * best.score and _differs(
            found, points, best, other, p
        ):
            return Failure(
                "ambiguous", f"agreement {best.score:.3f} and {other.score:.3f}"
            )
    return _choose_turn(found, artifact, points, best) if p["turns"] else best


def _differs(
    found: Field,
    points: FloatArray,
    best: ScoredPose,
    other: ScoredPose,
    p: Mapping[str, float],
) -> bool:
    """Return whether there is a valley between two poses, but for whole periods."""
    period = 2 * math.pi / max(p["order"], 1.0)
    turn = math.remainder(other.theta_rad - best.theta_rad, period)
    right, down = other.column - best.column, other.row - best.row
    rim = rim_px(points)
    far = max(math.hypot(right, down), abs(turn) * rim)
    between = np.arange(1, math.ceil(far)) / math.ceil(far) if far > 2 else ()
    return any(
        score(
            found,
            points,
            best.column + share * right,
            best.row + share * down,
            best.theta_rad + share * turn,
        )
        < _VALLEY * other.score
        for share in between
    )


def _misplaced(
    fitted: ContourFit, artifact: Artifact, guess: Guess, pose: ScoredPose
) -> Failure | None:
    """Return why the fit cannot be the target, if it cannot."""
    p = artifact.parameters
    moved = math.hypot(fitted.column - guess.column, fitted.row - guess.row)
    if moved > 1.5 * p["search_px"] + 2:
        return Failure("outside", f"{moved:.1f} px from the guess")
    drifted = math.hypot(fitted.column - pose.column, fitted.row - pose.row)
    if drifted > 4:
        return Failure("diverged", f"the fit moved by {drifted:.1f} px")
    if abs(fitted.scale - 1) > p["scale_off"]:
        return Failure("scale_off", f"{fitted.scale:.3f} times the size")
    turn = abs(math.remainder(fitted.theta_rad - p["theta_rad"], 2 * math.pi))
    if p["turns"] and turn > p["range_rad"] * 1.2 + 0.01 and p["range_rad"] < 3:
        return Failure("outside", f"turned by {turn:.3f} rad")
    return None


def _answer(
    image: FloatArray, artifact: Artifact, points: FloatArray, fitted: ContourFit
) -> Measurement | Failure:
    """Return the measurement; its score is how well directions agree at the end."""
    p = artifact.parameters
    fine = field(image, 1, p["noise"])
    agreed = score(fine, points, fitted.column, fitted.row, fitted.theta_rad)
    if agreed < _LEAST_SCORE:
        return _low(agreed, _LEAST_SCORE)
    known = bool(p["turns"])
    theta = math.remainder(fitted.theta_rad, 2 * math.pi)
    return Measurement(
        column=fitted.column,
        row=fitted.row,
        theta_rad=theta if known else None,
        score=min(agreed, 1.0),
        spread_px=math.hypot(fitted.spread_px, p["bias_px"]),
        spread_theta_rad=math.hypot(fitted.spread_theta_rad, p["bias_rad"])
        if known
        else None,
        zoom=fitted.scale,
    )


def _low(agreed: float, least: float) -> Failure:
    """Return the failure of a poor match."""
    return Failure("low_score", f"agreement {agreed:.3f}, at least {least}")


def _choose_turn(
    fine: Field, artifact: Artifact, points: FloatArray, pose: ScoredPose
) -> ScoredPose | Failure:
    """Return the pose at the one rotation that the symmetry's breach confirms."""
    p = artifact.parameters
    breaking = points[artifact.arrays["breaking"] > 0]
    angles = list(_turned(p, pose, breaking))
    if len(angles) < 2 or not len(breaking):
        return pose
    whole = max(score(fine, points, pose.column, pose.row, pose.theta_rad), 1e-9)
    scores = scan(fine, breaking, pose, angles) / whole
    best = int(scores.argmax())
    # neighbours of the best angle are no rivals
    away = np.abs([math.remainder(a - angles[best], 2 * math.pi) for a in angles])
    rim = rim_px(breaking)
    others = scores[away * rim > _SAME_PX]
    second = max(float(others.max()), 0.0) if len(others) else 0.0
    if scores[best] < _LEAST:
        return Failure(
            "no_notch",
            f"what breaks the symmetry scores {scores[best]:.3f}, at least {_LEAST}",
        )
    if second > _RUNNER_UP * scores[best]:
        return Failure(
            "ambiguous",
            f"two turns of the symmetry score {scores[best]:.3f} and {second:.3f}",
        )
    return replace(pose, theta_rad=angles[best])


def _turned(
    p: Mapping[str, float], pose: ScoredPose, breaking: FloatArray
) -> Iterator[float]:
    """Yield the angles, within the range, that look alike but for the breach."""
    order = int(p["order"])
    if order == ROUND:  # half a sample apart, where the breach is
        rim = rim_px(breaking)
        order = math.ceil(2 * math.pi * rim * 2)
    limit = p["range_rad"] * 1.2 + 0.01
    for k in range(order):
        angle = pose.theta_rad + 2 * math.pi * k / order
        if abs(math.remainder(angle - p["theta_rad"], 2 * math.pi)) <= limit:
            yield angle
