"""One feature of several: the one whose chain does the look best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from featuresel.constraints import Constraints, Limits
from featuresel.routines import Target
from featuresel.score import Score
from featuresel.select import Selection, best, select


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """A feature that was tried: as what, with what scores, how much of it is seen."""

    target: Target
    scores: tuple[Score, ...]  # of its chains, at least one
    visible: float | None = None  # share of its edges; None: not known


@dataclass(frozen=True, slots=True, kw_only=True)
class Pick:
    """The feature that is used, and a sentence for every feature."""

    name: str | None  # None: no feature passes
    selections: tuple[tuple[str, Selection], ...]  # per feature, in the order given
    reasons: tuple[tuple[str, str], ...]
    advice: str  # "" if a feature was picked; else per feature what to relax

    @property
    def selection(self) -> Selection | None:
        """Return the selection of the feature that is used."""
        return dict(self.selections).get(self.name or "")


def pick(
    options: Sequence[Option],
    *,
    tolerance_um: float,
    tolerance_theta_rad: float | None,
    limits: Limits | None = None,
) -> Pick:
    """Return the feature whose chosen chain is the best by the rule of `select`.

    Each feature's chains are judged by themselves; of those chosen the cheapest is
    taken unless it leaves no room, and the first by name among equals. Scores are of
    the point that the look is to locate, wherever the feature lies.

    Raises
    ------
    ValueError
        If there is no option or two targets share a name; as `select` does.
    """
    names = [option.target.name for option in options]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"options must have names that differ, got {names}")
    selections = {
        option.target.name: select(
            option.scores,
            tolerance_um=tolerance_um,
            tolerance_theta_rad=tolerance_theta_rad,
            limits=limits,
            target=option.target,
            visible=option.visible,
        )
        for option in options
    }
    task = Constraints(
        tolerance_um=tolerance_um,
        tolerance_theta_rad=tolerance_theta_rad,
        limits=limits or Limits(),
    )
    able = {n: s.chosen for n, s in sorted(selections.items()) if s.chosen is not None}
    taken = best(list(able.values()), task)
    name = next((n for n, score in able.items() if score is taken), None)
    return Pick(
        name=name,
        selections=tuple((n, selections[n]) for n in names),
        reasons=tuple((n, _reason(selections[n], taken)) for n in names),
        advice=""
        if name is not None
        else "; ".join(f"{n}: {selections[n].advice}" for n in names),
    )


def _reason(selection: Selection, taken: Score | None) -> str:
    """Return why a feature is used or not."""
    chosen = selection.chosen
    if chosen is None:
        return f"rejected: {selection.advice}"
    numbers = f"2 sigma + |bias| {chosen.need_um:.3g} um, cost {chosen.cost:.3g}"
    return f"picked: {numbers}" if chosen is taken else f"passes: {numbers}"
