"""Work of a compile: the images that its looks are made of, planned and made."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar, get_args

from microplan.featuresel.trials.trials import Map
from microplan.planner.task.presets import Effort

A = TypeVar("A")
B = TypeVar("B")

Stage = Literal["race", "other features", "pairs", "usable range", "random trials"]
STAGES: tuple[Stage, ...] = get_args(Stage)  # in the order that looks have them
LEAST_PAIRS = 12  # poses of pairs: more are made only where these leave doubt
# What others cost in images of trials: all pairs at a pose, a draw of the usable range,
# of which most directions leave many out.
PAIRS, DRAW = 3.0, 0.5
DIRECTIONS = 4  # of a usable range

# Told of each stage of a look, and of how many images more it has made.
Told = Callable[[Stage, float], None]


def nobody(_stage: Stage, _images: float) -> None:
    """Take what is told, and pass it on to nobody."""


def trials_of(item: object) -> float:
    """Return how many images an item stands for: of trials one each, else none."""
    return len(item) if isinstance(item, tuple) else 0


def telling(
    spread: Map, told: Told, stage: Stage, images: Callable[[Any], float]
) -> Map:
    """Return a `map` that tells what it makes: `images` of each item done."""

    def spread_and_tell(
        function: Callable[[A], B], items: Iterable[A], /
    ) -> Iterable[B]:
        asked = tuple(items)
        if asked:
            told(stage, 0.0)
        for item, found in zip(asked, spread(function, asked), strict=True):
            told(stage, images(item))
            yield found

    return spread_and_tell


def planned_images(effort: Effort) -> tuple[float, ...]:
    """Return the images of each of the `STAGES` of one look that an effort plans.

    Nobody knows beforehand whether further features are wanted.
    """
    planned: Mapping[Stage, float] = {
        "race": effort.trials,
        "pairs": PAIRS * min(effort.pairs, LEAST_PAIRS),
        "usable range": DIRECTIONS * DRAW * effort.range_draws,
        "random trials": effort.random_trials,
    }
    return tuple(planned.get(stage, 0.0) for stage in STAGES)


@dataclass(frozen=True, slots=True)
class Images:
    """Images of looks; what a cache has is not among them."""

    made: float = 0.0  # or left out, where fewer were enough
    needed: float = 0.0  # as far as is known

    @property
    def left(self) -> float:
        """Return what is still to be made."""
        return self.needed - self.made


@dataclass(frozen=True, slots=True, kw_only=True)
class CompileProgress:
    """How far a compile has come."""

    step: str  # that is being compiled
    look: str  # the present one of the step, "" before the first
    stage: str  # of that look, "" before the first
    steps: int  # done
    all_steps: int
    here: Images  # of the present look
    all: Images  # of all looks


_BEGUN = 1e-6  # images: a stage that made none yet, but is begun


@dataclass(slots=True)
class _Look:
    """Images of a look by stage."""

    made: list[float] = field(default_factory=lambda: [0.0] * len(STAGES))
    is_ended: bool = False

    def count(self, stage: Stage, images: float) -> None:
        """Count images that were made."""
        at = STAGES.index(stage)
        self.made[at] = max(self.made[at] + images, _BEGUN)

    def last(self) -> int | None:
        """Return the last stage that is begun, None if none is."""
        return max((k for k, images in enumerate(self.made) if images), default=None)

    def images(self, planned: Sequence[float]) -> Images:
        """Return what is made and what is known to be needed.

        A stage that is over needs no more; where it made none, none were to be made.
        """
        over = len(STAGES) if self.is_ended else self.last() or 0
        found = list(zip(self.made, planned, strict=True))
        past = sum(max(m, p) for m, p in found[:over] if m)
        now = sum(m for m, _ in found[over:])
        return Images(past + now, past + sum(max(m, p) for m, p in found[over:]))


@dataclass(slots=True, kw_only=True)
class Work:
    """Images of all looks of a compile; changes no result.

    A look that was not planned is not counted.
    """

    heard: Callable[[CompileProgress], None] = lambda _reached: None
    looks: dict[str, _Look] = field(default_factory=dict)
    planned: tuple[float, ...] = ()  # of each look, by stage
    at: tuple[int, int, str] = (0, 0, "")  # steps done, all steps, the present one
    look: str = ""  # the present one

    def plan(self, looks: Sequence[str], effort: Effort) -> None:
        """Begin with the looks that will probably be asked for, nothing made."""
        self.looks = {look: _Look() for look in looks}
        self.planned = planned_images(effort)

    def step(self, done: int, steps: int, name: str) -> None:
        """Begin a step, and say so."""
        self.at, self.look = (done, steps, name), ""
        self.say()

    def told(self, look: str) -> Told:
        """Make a look the present one; return what is to be told of its stages."""
        self.look = look
        return self.counting(look)

    def counting(self, look: str) -> Told:
        """Return what is to be told of a look's stages."""

        def tell(stage: Stage, images: float) -> None:
            if look in self.looks:
                self.looks[look].count(stage, images)
            self.say()

        return tell

    def ended(self, look: str) -> None:
        """Take a look as done, whatever was planned."""
        if look in self.looks:
            self.looks[look].is_ended = True

    def say(self) -> None:
        """Say how far the compile has come."""
        known = {name: each.images(self.planned) for name, each in self.looks.items()}
        done, steps, name = self.at
        self.heard(
            CompileProgress(
                step=name,
                look=self.look,
                stage=self._stage(),
                steps=done,
                all_steps=steps,
                here=known.get(self.look, Images()),
                all=Images(
                    sum(each.made for each in known.values()),
                    sum(each.needed for each in known.values()),
                ),
            )
        )

    def _stage(self) -> str:
        """Return what was begun last of the present look, "" if nothing was."""
        here = self.looks.get(self.look)
        last = None if here is None else here.last()
        return "" if last is None else STAGES[last]
