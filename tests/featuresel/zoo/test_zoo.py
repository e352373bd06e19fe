"""Selection refuses each of the zoo for its own reason, and keeps what is good."""

from __future__ import annotations

import sys
from dataclasses import replace
from types import ModuleType

import pytest

from microplan.featuresel.look.design import design
from microplan.featuresel.routines import registry
from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.select import select
from microplan.featuresel.trials.score import score
from microplan.featuresel.trials.trials import prepare, run
from tests.featuresel.zoo.zoo import ANIMALS, CAGES

TRIALS = 16


@pytest.fixture
def zoo(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the registry load the zoo's animals like any routine."""
    cages = ModuleType("animals")
    monkeypatch.setitem(sys.modules, "animals", cages)
    for animal in ANIMALS:
        setattr(cages, animal.name, animal)
    names = {animal.name: f"animals:{animal.name}" for animal in ANIMALS}
    monkeypatch.setattr(registry, "REGISTRY", {**registry.REGISTRY, **names})


@pytest.mark.usefixtures("zoo")
@pytest.mark.parametrize("name", sorted(CAGES))
def test_each_is_rejected_for_its_own_reason(name: str) -> None:
    cage = CAGES[name]
    case = cage.look()
    chains = (cage.good, *(resident.chain for resident in cage.residents))
    ready = prepare(case, chains)
    outcomes = run(case, ready, design(case, TRIALS, 7))
    for resident in cage.residents:
        judged = replace(
            case,
            tolerance_um=resident.tolerance_um,
            tolerance_theta_rad=resident.tolerance_theta_rad,
        )
        scores = {s.chain: s for s in score(judged, ready, outcomes)}
        found = select(
            [scores[cage.good], scores[resident.chain]],
            Constraints(
                tolerance_um=resident.tolerance_um,
                tolerance_theta_rad=resident.tolerance_theta_rad,
            ),
        )
        reason = dict(found.reasons)[resident.chain]
        bad = scores[resident.chain]
        assert found.chosen is not None, (resident.chain, found)
        assert found.chosen.chain == cage.good
        assert reason.startswith("rejected"), (resident.chain, reason)
        assert resident.words in reason, (resident.chain, reason)
        assert resident.shows(bad), (resident.chain, bad)


def test_the_zoo_is_large_enough_and_no_animal_is_a_neighbour() -> None:
    shown = {resident.chain for cage in CAGES.values() for resident in cage.residents}
    assert len(shown) >= 10
    assert not {animal.name for animal in ANIMALS} & set(registry.REGISTRY)
    used = {name for chain in shown for name in chain}
    assert {animal.name for animal in ANIMALS} <= used
