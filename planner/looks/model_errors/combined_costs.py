"""Costs of a chain with its fallback, and of several features together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from microplan.schemas.plan import ModelCost


def of_either(one: ModelCost | None, other: ModelCost | None) -> ModelCost | None:
    """Return the cost of a chain with the half-widths of its fallback, if wider."""
    if one is None or other is None:
        return one
    wider = [
        tuple(max(pair) for pair in zip(a, b, strict=True))
        for a, b in (
            (one.half_width_um, other.half_width_um),
            (one.interval_um, other.interval_um),
            (one.sigma_um, other.sigma_um),
            (one.drawn_um, other.drawn_um),
            (one.spread_um or one.sigma_um, other.spread_um or other.sigma_um),
        )
    ]
    half, interval, sigma, drawn, spread = wider
    x_um, y_um = map(min, one.spared_um, other.spared_um)
    return replace(
        one,
        half_width_um=(half[0], half[1]),
        interval_um=(interval[0], interval[1]),
        sigma_um=(sigma[0], sigma[1]),
        drawn_um=(drawn[0], drawn[1]),
        spread_um=(spread[0], spread[1]),
        spared_um=(x_um, y_um),
    )


def together_cost(
    parts: Sequence[ModelCost | None], apart_um: float
) -> ModelCost | None:
    """Return what the features of a set cost its place and angle, at most.

    Each feature's own bias is taken off. A mean with weights errs by no more than the
    worst of them, on either axis; an angle by two such errors over their distance
    `apart_um`.
    """
    known = [part for part in parts if part is not None]
    if not known:
        return None
    half, interval, sigma, drawn, spread = (
        max(max(value) for value in values)
        for values in (
            [part.half_width_um for part in known],
            [part.interval_um for part in known],
            [part.sigma_um for part in known],
            [part.drawn_um for part in known],
            [part.spread_um or part.sigma_um for part in known],
        )
    )
    turn = 2 / apart_um if apart_um > 0 else None
    own = [part for part in known if part.half_width_theta_rad is not None]
    return ModelCost(
        pairs=min(part.pairs for part in known),
        freedom=min(part.freedom for part in known),
        bias_um=(0.0, 0.0),
        half_width_um=(half, half),
        interval_um=(interval, interval),
        sigma_um=(sigma, sigma),
        bias_theta_rad=_most(own, "bias_theta_rad", 0.0, turn),
        half_width_theta_rad=_most(own, "half_width_theta_rad", half, turn),
        interval_theta_rad=_most(own, "interval_theta_rad", interval, turn),
        sigma_theta_rad=_most(own, "sigma_theta_rad", sigma, turn),
        drawn_um=(drawn, drawn),
        spread_um=(spread, spread),
        spread_theta_rad=_most(own, "spread_theta_rad", spread, turn),
        drawn_theta_rad=_most(own, "drawn_theta_rad", drawn, turn),
    )


def _most(
    own: Sequence[ModelCost], name: str, place_um: float, turn: float | None
) -> float | None:
    """Return the largest of features' own angles and of that of their places."""
    values = [abs(float(getattr(part, name) or 0.0)) for part in own]
    if turn is not None:
        values.append(turn * place_um)
    return max(values, default=None)
