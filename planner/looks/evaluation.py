"""A look's case, what was tried on it, and the arrays that its routines need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact, Failure
from microplan.featuresel.routines.registry import load
from microplan.featuresel.selection.evaluate import RoutineComparison
from microplan.featuresel.selection.select import Selection
from microplan.featuresel.trials.outcomes import Outcomes
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.trials import PreparedRoutines
from microplan.optics.render.fidelity import Fidelity
from microplan.schemas import plan as p

Arrays = Mapping[str, Mapping[str, npt.NDArray[np.float32]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """A case, what was tried on it, and what came of it."""

    case: LookCase
    fidelity: Fidelity
    prepared: PreparedRoutines
    outcomes: Outcomes
    scores: tuple[ChainScore, ...]
    selection: Selection

    @classmethod
    def of(
        cls, case: LookCase, fidelity: Fidelity, found: RoutineComparison
    ) -> Evaluation:
        """Return what a contest over a case showed."""
        return cls(
            case=case,
            fidelity=fidelity,
            prepared=found.prepared,
            outcomes=found.outcomes,
            scores=found.scores,
            selection=found.selection,
        )


def used(tried: Evaluation) -> tuple[str, ...]:
    """Return the routines of chain and fallback, each once."""
    selection = tried.selection
    spare = selection.fallback.chain if selection.fallback else ()
    chosen = selection.chosen.chain if selection.chosen else ()
    return tuple(dict.fromkeys(chosen + spare))


def _artifact(tried: Evaluation, name: str) -> Artifact:
    """Return what a routine prepared; one that failed to is never selected."""
    found = tried.prepared.artifacts[name]
    if isinstance(found, Failure):
        raise ValueError(f"{name} was selected but not prepared: {found.message}")
    return found


def arrays_of(look: str, tried: Evaluation) -> Arrays:
    """Return the arrays of the routines used, by their path in the plan folder."""
    return {
        _array_path(look, name): _artifact(tried, name).arrays
        for name in used(tried)
        if _artifact(tried, name).arrays
    }


def _array_path(look: str, name: str) -> str:
    return f"artifacts/{look}.{name}.npz"


def use_of(look: str, tried: Evaluation, name: str) -> p.RoutineUse:
    """Return one routine of a chain as the plan has it."""
    artifact = _artifact(tried, name)
    return p.RoutineUse(
        id=name,
        version=load(name).VERSION,
        parameters=artifact.parameters,
        arrays=_array_path(look, name) if artifact.arrays else None,
    )
