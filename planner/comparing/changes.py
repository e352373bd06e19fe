"""One difference between two plans, and what kind of thing it is about."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

Kind = Literal[
    "feasibility", "steps", "choice", "learnt", "feature", "motion", "prediction",
    "effects", "picture", "inputs", "evidence", "other",
]  # fmt: skip
Trend = Literal["better", "worse", ""]

KINDS: tuple[Kind, ...] = get_args(Kind)
# what a kind is about, for help and documentation
ABOUT: Mapping[Kind, str] = {
    "feasibility": "whether the plan is feasible, and the chance of success",
    "steps": "steps and looks added, removed, reordered, or of another verb or target",
    "choice": "routines, zoom, focus, light, method",
    "learnt": "parameters that the routines chosen learnt from predicted images",
    "feature": "features of a part or a look: added, removed, moved",
    "motion": "where axes go, where things are thought to be, what to keep out of",
    "prediction": "errors, ranges, times and chances that the plan promises",
    "effects": "what is modelled, at which level, what is left out",
    "picture": "reference images, by pixel",
    "inputs": "task, workcell, drawings, seed, preset",
    "evidence": "what trials gave, of the routines chosen and of those rejected",
    "other": "all else",
}


class Name(str):
    """A part of a path that somebody chose, as the id of a step; the rest are keys."""

    __slots__ = ()


def keys_of(path: Sequence[str]) -> str:
    """Return a path with its names masked: a step called "reason" is no reason."""
    return "/".join(":" if isinstance(part, Name) else part for part in path)


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One difference that is beyond its tolerance."""

    path: tuple[str, ...]  # ("steps", "over_shaft", "control", "gain")
    kind: Kind
    old: Any  # plain JSON data; None if there was none
    new: Any
    says: str  # in words: what became what, and by how much
    trend: Trend = ""

    @property
    def where(self) -> str:
        """Return the path as tolerances name it."""
        return "/".join(self.path)
