"""What trials of a look have shown, for another question about the same look."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact, Failure
from microplan.featuresel.trials.outcomes import Book
from microplan.optics.lens.sensor import CountArray

_MOST_BYTES = 1 << 26  # of pictures: 64 full frames, and far more regions


@dataclass(frozen=True, slots=True)
class Known:
    """What a look's images and routines gave; grows, and changes no result.

    Nothing of it depends on what the look has to meet. Of pictures only as many are
    kept as have room, each as the camera's counts, so that nothing is lost.
    """

    artifacts: dict[str, Artifact | Failure] = field(default_factory=dict)
    outcomes: Book = field(default_factory=Book)
    pictures: dict[int, CountArray] = field(default_factory=dict)
    facts: dict[str, float | None] = field(default_factory=dict)

    def keep(self, trial: int, counts: CountArray | None) -> None:
        """Keep a trial's counts, (rows, columns), if there are any, and room."""
        if (
            counts is not None
            and (len(self.pictures) + 1) * counts.nbytes <= _MOST_BYTES
        ):
            self.pictures[trial] = counts

    def fact(self, name: str, find: Callable[[], float | None]) -> float | None:
        """Return what is known under a name, or what is found now."""
        if name not in self.facts:
            self.facts[name] = find()
        return self.facts[name]


@dataclass(slots=True)
class Looks:
    """What is known of the look that was asked about last."""

    about: tuple[LookCase, int] | None = None
    known: Known = field(default_factory=Known)

    def of(self, case: LookCase, root_seed: int) -> Known:
        """Return what is known of a look, whatever it has to meet."""
        look = replace(case, tolerance_um=1.0, tolerance_theta_rad=None)
        if self.about != (look, root_seed):
            self.about, self.known = (look, root_seed), Known()
        return self.known
