"""Chains, the registry and the candidates."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import pytest

from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.chain import ChainState, advance, measure_chain
from microplan.featuresel.routines.contract import Artifact, Failure, Guess, Measurement
from microplan.featuresel.routines.registry import REGISTRY, load
from microplan.featuresel.trials.chains import chains

Look = Callable[[str], LookCase]


def stages(case: LookCase, *names: str) -> list[tuple[str, Artifact]]:
    found = []
    for name in names:
        artifact = load(name).prepare(nominal_render(case), case.target)
        assert isinstance(artifact, Artifact)
        found.append((name, artifact))
    return found


def start(case: LookCase) -> Guess:
    return Guess(column=case.target.column, row=case.target.row)


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_every_routine_says_what_it_is(name: str) -> None:
    routine = load(name)
    assert name == routine.name
    assert routine.kinds
    assert set(routine.provides) <= {"xy", "theta", "z", "zoom"}
    assert routine.capture_px > 0


def test_a_routine_of_the_earlier_contract_is_refused_with_the_new_words(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    old = ModuleType("old_routine")
    vars(old).update(NAME="old", GIVES=("xy",), NEEDS=(), DEAR=False, CONTROL=True)
    monkeypatch.setitem(sys.modules, "old_routine", old)
    assert isinstance(REGISTRY, dict)
    for line in ("old_routine", "old_routine:OLD"):
        monkeypatch.setitem(REGISTRY, "old", line)
        with pytest.raises(TypeError) as refused:
            load("old")
        said = str(refused.value)
        assert (
            "(name, version, kinds, principle, provides, requires, capture_px" in said
        )
        for word in ("GIVES is now provides", "NEEDS is now requires",
                     "DEAR is now expensive", "CONTROL is now baseline"):  # fmt: skip
            assert word in said


def test_routines_load_neither_scipy_nor_the_optics() -> None:
    program = (
        "import sys; from microplan.featuresel.routines.registry import REGISTRY; "
        "import microplan.featuresel.routines.focus.measures; "
        "from microplan.featuresel.routines.registry import load; "
        "[load(n) for n in REGISTRY]; "
        "heavy = ('scipy', 'skimage', 'microplan.optics'); "
        "print([m for m in heavy if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", ["find_gear", "post", "jaws", "bracket"])
def test_candidates_fit_their_target(name: str, look: Look) -> None:
    target = look(name).target
    for chain in chains(target):
        assert all(target.kind in load(routine).kinds for routine in chain)
        assert not load(chain[0]).requires


def test_the_angle_is_tried_only_where_a_notch_tells_it(look: Look) -> None:
    gear = look("find_gear").target
    assert any("tooth_notch" in chain for chain in chains(gear))
    plain = {k: v for k, v in gear.parameters.items() if not k.startswith("notch")}
    for chain in chains(replace(gear, parameters=plain)):
        assert "tooth_notch" not in chain


def test_the_angle_comes_with_the_place_before_it(look: Look) -> None:
    case = look("find_gear")
    image = nominal_render(case)(dx_um=5.0, dy_um=-4.0, theta_rad=2.0)
    place = measure_chain(image, stages(case, "otsu", "circle_caliper"), start(case))
    both = stages(case, "otsu", "circle_caliper", "tooth_notch")
    whole = measure_chain(image, both, start(case))
    assert isinstance(place, Measurement)
    assert isinstance(whole, Measurement)
    assert (whole.column, whole.row) == (place.column, place.row)
    assert whole.spread_px == place.spread_px > 0
    assert place.theta_rad is None
    assert whole.theta_rad == pytest.approx(2.0 + case.theta_rad, abs=1e-3)


def test_the_first_failure_ends_the_chain_and_says_who(look: Look) -> None:
    case = look("find_gear")
    chain = stages(case, "otsu", "circle_caliper")
    found = measure_chain(nominal_render(look("post"))(), chain, start(case))
    assert isinstance(found, Failure)
    assert found.code == "no_blob"
    assert found.message.startswith("otsu: ")


def test_a_rough_place_is_not_handed_over(look: Look) -> None:
    case = look("find_gear")
    image = nominal_render(case)(dx_um=5.0, dy_um=-4.0, theta_rad=2.0)
    chain = stages(case, "circle_caliper", "tooth_notch")
    placed = advance(image, *chain[0], ChainState(guess=start(case)))
    assert isinstance(placed, ChainState)
    assert placed.found is not None
    known = load("tooth_notch").capture_px / 3  # three spreads must fit
    for spread_px, captured in ((known, True), (known * 1.01, False)):
        rough = replace(placed, found=replace(placed.found, spread_px=spread_px))
        after = advance(image, *chain[1], rough)
        assert isinstance(after, ChainState) == captured
        if isinstance(after, Failure):
            assert after.code == "not_captured"
            assert "it captures 2 px" in after.message


def test_focus_and_zoom_stay_with_the_chain(look: Look) -> None:
    case = look("find_gear")
    image = nominal_render(case)()
    name, artifact = stages(case, "circle_caliper")[0]
    known = replace(start(case), z_um=3.0, zoom=1.01)
    after = advance(image, name, artifact, ChainState(guess=known))
    assert isinstance(after, ChainState)
    assert (after.guess.z_um, after.guess.zoom) == (3.0, 1.01)


def test_an_empty_chain_is_an_error(look: Look) -> None:
    with pytest.raises(ValueError, match="at least one"):
        measure_chain(nominal_render(look("post"))(), [], start(look("post")))
