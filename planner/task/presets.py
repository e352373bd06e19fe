"""Presets of effort, `fast`, `balanced` or `accurate`: one row of numbers each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

Preset = Literal["fast", "balanced", "accurate"]
Sketch = Literal["sketch"]  # no preset of a task: nothing is tried


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """What a preset spends on one look."""

    trials: int  # perturbed images a look's chains are compared on
    random_trials: int  # fresh ones that the chosen chain's sigma and bias come from
    range_draws: int  # images at each focus and zoom of the usable range, at least 12
    drift_draws: int  # images at each drift of the largest errors allowed
    image_error: float  # of unit contrast, that images may have
    limited: bool  # the physical limit is computed, too, to compare routines with
    features: int  # of a part, compared where the target alone is not enough
    thorough: bool  # also tries routines that are expensive to prepare
    # of images that tell what a model's errors cost a chain, if that matters; even
    pairs: int = 12


# 59 trials without a failure show .95 at one-sided 95 % (Clopper-Pearson), 299 .99.
# Failures have four fifths of that doubt: 65 random trials show .95 of a plan whose
# looks are made once, 97 of one whose looks are made 1.5 times.
PRESETS: Mapping[Preset, Effort] = {
    "fast": Effort(
        trials=24,
        random_trials=64,
        range_draws=12,
        drift_draws=2,
        image_error=0.005,
        limited=False,
        features=2,
        thorough=False,
    ),
    "balanced": Effort(
        trials=64,
        random_trials=98,
        range_draws=12,
        drift_draws=4,
        image_error=0.002,
        limited=True,
        features=3,
        thorough=False,
        pairs=24,
    ),
    "accurate": Effort(
        trials=304,
        random_trials=1024,
        range_draws=16,
        drift_draws=8,
        image_error=0.0005,
        limited=True,
        features=6,
        thorough=True,
        pairs=48,
    ),
}


ASKED: tuple[str, ...] = (*get_args(Sketch), *PRESETS)  # what a call may ask for


Axis = Literal["preset", "trials", "frames", "zoom"]
Vary = Sequence[tuple[Axis, tuple[str, ...]]]  # axes and values; (): its usual ones

AXES: tuple[Axis, ...] = get_args(Axis)


def parse_vary(text: str) -> Vary:
    """Return axes and values of `preset,trials=24:64`; ValueError if it is no such."""
    found: list[tuple[Axis, tuple[str, ...]]] = []
    for part in text.split(","):
        name, equals, values = part.partition("=")
        axis = next((axis for axis in AXES if axis == name.strip()), None)
        if axis is None or (equals and not values):
            raise ValueError(text)
        if any(axis == other for other, _ in found):
            raise ValueError(text)
        found.append((axis, tuple(values.split(":")) if equals else ()))
    return found
