"""Radial calipers: edges along rays from the guess, and a circle through them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.routines import work
from microplan.featuresel.routines.circle.circle_fit import (
    FittedCircle,
    fit_centre,
    fit_circle,
)
from microplan.featuresel.routines.circle.rim_plan import rim_radius_um
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Routine,
    Target,
)
from microplan.featuresel.routines.sampling import (
    STEP_PX,
    LineEdges,
    best_width,
    cubic,
    edge_kernel,
    find_edges,
    line_samples,
)

_FAINT = 0.02  # step height below which an edge drowns in 8 bits and shot noise
_WEAKEST = 0.3  # of the predicted step: light falls to .7, focus errors take the rest
_FEWEST = 0.5  # of the rays must carry an edge, and of those half must fit
_SEARCH_RAYS = 60  # long rays are expensive, and a pixel is good enough
# Of half the search: edges found anywhere in it, as in noise, scatter by 1 / sqrt(3).
_SCATTERED = 0.5 / math.sqrt(3)
_REFINED = 2  # rounds: the search leaves a pixel, the first round .01 px
# Of the radius, at least 1 px: zoom errors stay below 2 %; 8 um out of focus, edges on
# the slope of a shade move by 6 %.
_RADIUS_OFF = 0.1


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return radius, polarity, step and filter width of the circle's nominal edge."""
    radius_px = rim_radius_um(target) * target.px_per_um
    if radius_px < 3:
        return Failure("too_small", f"radius of {radius_px:.2f} px, at least 3")
    image = render()
    span = _span(radius_px)
    profile = _mean_profile(image, target.column, target.row, radius_px, span)
    if profile is None:
        return Failure("outside", "less than half the circle is in view")
    width_px = best_width(profile)
    middle, gap = len(profile) // 2, int(1.5 * width_px / STEP_PX) + 1
    step = float(profile[middle + gap] - profile[middle - gap])
    if abs(step) < _FAINT:
        return Failure(
            "no_edge",
            f"predicted step of {step:.3f} at {radius_px:.1f} px, at least {_FAINT}",
        )
    first = Artifact(
        parameters={
            "radius_px": radius_px,
            "seen_px": radius_px,
            "width_px": width_px,
            "rising": float(step > 0),
            "step": abs(step),
            "search_px": target.search_px,
        }
    )
    nominal = Guess(column=target.column, row=target.row)
    circle = _refine(image, first, nominal)
    if isinstance(circle, Failure):
        return circle
    return Artifact(parameters={**first.parameters, "seen_px": circle.radius_px})


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the circle's centre, px, in `image`, (rows, columns) 0..1.

    Fails if the circle is faint, cut off or of another size.
    """
    seed = _search(image, artifact, guess)
    if isinstance(seed, Failure):
        return seed
    circle = _refine(image, artifact, seed)
    if isinstance(circle, Failure):
        return circle
    p = artifact.parameters
    if circle.rms_px > _SCATTERED * _half_px(p):
        return Failure(
            "scattered",
            f"edges lie {circle.rms_px:.2f} px about the circle, "
            f"at most {_SCATTERED * _half_px(p):.2f}",
        )
    off = abs(circle.radius_px - p["seen_px"])
    if off > max(1.0, _RADIUS_OFF * p["radius_px"]):
        return Failure(
            "radius_off",
            f"radius {circle.radius_px:.2f} px, predicted {p['seen_px']:.2f}",
        )
    return Measurement(
        column=circle.column,
        row=circle.row,
        score=float(circle.used.mean()),
        spread_px=circle.spread_px,
    )


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    p = artifact.parameters
    kernel = len(edge_kernel(p["width_px"]))
    search = len(line_samples(p["search_px"] + 2 * p["width_px"], p["width_px"]))
    length, rays = (
        len(line_samples(_half_px(p), p["width_px"])),
        len(_angles(p["radius_px"])),
    )
    refined = work.edges(rays, length, kernel) + work.circle(rays)
    seed = work.edges(_SEARCH_RAYS, search, kernel) + work.centre()
    return seed + _REFINED * refined


CIRCLE_CALIPER = Routine(
    name="circle_caliper",
    version="3",
    kinds=("circle", "teeth"),
    principle="edges",
    provides=("xy",),
    prepare=prepare,
    measure=measure,
    cost=cost,
)


def _span(radius_px: float) -> float:
    """Return how far from the edge profiles are taken to choose the filter, px."""
    return max(3.0, min(0.6 * radius_px, 20.0))


def _mean_profile(
    image: FloatArray, column: float, row: float, radius_px: float, span_px: float
) -> FloatArray | None:
    """Return the median radial profile about the edge; None if too little is in view.

    A median over rays, so that a notch does not soften the edge.
    """
    count = int(span_px / STEP_PX)
    radii = radius_px + np.arange(-count, count + 1) * STEP_PX
    angles = _angles(radius_px)
    values, inside = cubic(
        image,
        column + np.outer(np.cos(angles), radii),
        row - np.outer(np.sin(angles), radii),
    )
    whole = inside.all(axis=1)
    if whole.mean() < _FEWEST:
        return None
    median: FloatArray = np.median(values[whole], axis=0)
    return median


def _angles(radius_px: float, most: int = 180) -> FloatArray:
    """Return one ray per pixel of circumference, 48 to `most`."""
    count = int(np.clip(2 * math.pi * radius_px, 48, most))
    return np.linspace(0, 2 * math.pi, count, endpoint=False)


def _search(image: FloatArray, artifact: Artifact, guess: Guess) -> Guess | Failure:
    """Return the centre from long rays and the known radius, good to about a pixel."""
    p = artifact.parameters
    half = p["search_px"] + 2 * p["width_px"]
    angles = _angles(p["radius_px"], _SEARCH_RAYS)
    edges, columns, rows = _cast(image, artifact, guess, p["radius_px"], half, angles)
    good = _strong(edges, p["step"])
    if good.mean() < _FEWEST:
        return _few(good, edges)
    start = (guess.column, guess.row)
    column, row = fit_centre(columns[good], rows[good], p["radius_px"], start)
    moved = math.hypot(column - guess.column, row - guess.row)
    if moved > 1.5 * p["search_px"] + 2:
        return Failure(
            "outside", f"{moved:.1f} px from the guess, within {p['search_px']:.1f}"
        )
    return Guess(column=column, row=row)


def _refine(
    image: FloatArray, artifact: Artifact, seed: Guess
) -> FittedCircle | Failure:
    """Return the circle through edges near it, sought again from the better centre."""
    p = artifact.parameters
    column, row, radius = seed.column, seed.row, p["seen_px"]
    half = _half_px(p)
    angles = _angles(p["radius_px"])
    for _ in range(_REFINED):
        at = Guess(column=column, row=row)
        edges, columns, rows = _cast(image, artifact, at, radius, half, angles)
        good = _strong(edges, p["step"])
        if good.mean() < _FEWEST:
            return _few(good, edges)
        circle = fit_circle(columns[good], rows[good], (column, row, radius))
        column, row = circle.column, circle.row
        if math.hypot(column - seed.column, row - seed.row) > p["radius_px"]:
            return Failure("no_edge", "the edges make no circle")
    if circle.used.sum() < _FEWEST * len(good):
        return _few(circle.used, edges)
    return circle


def _half_px(p: Mapping[str, float]) -> float:
    """Return how far from a good centre's circle its edge is sought, px."""
    return max(2 * p["width_px"], min(0.15 * p["radius_px"], 6.0), 2.0)


def _cast(
    image: FloatArray,
    artifact: Artifact,
    at: Guess,
    radius_px: float,
    half_px: float,
    angles: FloatArray,
) -> tuple[LineEdges, FloatArray, FloatArray]:
    """Return the edge on each ray about `at` and where it is."""
    p = artifact.parameters
    offsets = line_samples(half_px, p["width_px"])
    cos, sin = np.cos(angles), np.sin(angles)
    radii = radius_px + offsets
    edges = find_edges(
        image,
        at.column + np.outer(cos, radii),
        at.row - np.outer(sin, radii),
        width_px=p["width_px"],
        rising=p["rising"] > 0,
    )
    distance = radius_px + edges.offset_px
    return edges, at.column + cos * distance, at.row - sin * distance


def _strong(edges: LineEdges, step: float) -> BoolArray:
    """Return which rays carry an edge of about the predicted height."""
    return edges.found & (edges.strength > max(_WEAKEST * step, _FAINT / 2))


def _few(good: BoolArray, edges: LineEdges) -> Failure:
    """Return the failure of a circle with too few edges."""
    if not good.any():
        return Failure(
            "no_edge", f"strongest step {edges.strength.max():.3f} is too weak"
        )
    return Failure(
        "few_rays",
        f"{int(good.sum())} of {len(edges.found)} rays meet the edge, "
        f"at least {_FEWEST:.0%}",
    )
