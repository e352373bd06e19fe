"""Chains made from what the routines declare."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

import pytest

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines import registry
from microplan.featuresel.routines.contract import Routine
from microplan.featuresel.routines.registry import REGISTRY, load
from microplan.featuresel.trials.chains import MOST_CHAINS, chains, has_angle, routines

Look = Callable[[str], LookCase]
LOOKS = ("find_gear", "between", "post", "jaws", "bracket")
COSTS = {"otsu": 1.0, "tooth_notch": 2.0, "circle_caliper": 3.0, "edge_caliper": 6.0}


def declared(**fields: Any) -> Routine:
    """Return a routine for teeth; chains are made before anything is measured."""
    teeth = replace(load("ncc"), kinds=("teeth",))
    return replace(teeth, **fields)


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Return what replaces the registry by some of it and new declarations."""

    def replace_registry(*kept: str, **added: Routine) -> None:
        lines = {name: REGISTRY[name] for name in kept}
        module = ModuleType("added")
        monkeypatch.setitem(sys.modules, "added", module)
        for name, routine in added.items():
            setattr(module, name, routine)
            lines[name] = f"added:{name}"
        monkeypatch.setattr(registry, "REGISTRY", lines)
        monkeypatch.setattr("microplan.featuresel.trials.chains.REGISTRY", lines)

    return replace_registry


def first(*kept: str) -> tuple[str, ...]:
    return ("otsu", "circle_caliper", "ncc", *kept)


@pytest.mark.parametrize("name", LOOKS)
def test_what_a_routine_needs_is_given_before_it(name: str, look: Look) -> None:
    target = look(name).target
    for chain in chains(target, controls=True):
        given: set[str] = set()
        for routine in map(load, chain):
            assert target.kind in routine.kinds
            if target.search_px > routine.capture_px:
                assert "xy" in given or "xy" not in routine.requires
            if target.theta_range_rad == math.pi and has_angle(target):
                assert "theta" in given or "theta" not in routine.requires
            given |= set(routine.provides)
        assert "xy" in given


@pytest.mark.parametrize("name", LOOKS)
def test_chains_are_few_and_none_comes_twice(name: str, look: Look) -> None:
    found = chains(look(name).target)
    assert 0 < len(found) == len(set(found)) <= MOST_CHAINS
    assert all(len(set(chain)) == len(chain) for chain in found)


def test_the_jobs_chains_come_from_the_declarations(
    look: Look, register: Callable[..., None]
) -> None:
    register(*first("tooth_notch", "edge_caliper"))
    gear = chains(look("find_gear").target)
    assert gear[:3] == (("otsu",), ("circle_caliper",), ("ncc",))
    assert ("otsu", "circle_caliper", "tooth_notch") in gear
    post = chains(look("post").target)
    assert {("otsu", "circle_caliper"), ("ncc", "circle_caliper")} < set(post)
    assert all("tooth_notch" not in chain for chain in post)
    assert set(chains(look("jaws").target)) == {
        ("edge_caliper",),
        ("ncc",),
        ("ncc", "edge_caliper"),
    }
    assert set(chains(look("bracket").target)) == {("ncc",), ("otsu",)}


def test_a_routine_joins_by_its_registry_line(
    look: Look, register: Callable[..., None]
) -> None:
    target = look("find_gear").target
    register(*first("tooth_notch"))
    before = chains(target)
    register(*first("tooth_notch"), new=declared())
    after = chains(target)
    assert ("new",) in after
    assert set(before) <= set(after)


def test_a_fine_routine_follows_what_gives_all_that_it_needs(
    look: Look, register: Callable[..., None]
) -> None:
    fit = declared(requires=("xy", "theta"), capture_px=2.0)
    step = declared(requires=("xy", "theta"), capture_px=0.5)
    register(*first("tooth_notch"), fit=fit, step=step)
    target = look("find_gear").target
    costs = {**COSTS, "ncc": 12.0, "fit": 4.0, "step": 0.1}
    for price in (None, costs):
        found = [c for c in chains(target, costs=price) if c[-1] in ("fit", "step")]
        assert found[0] == ("otsu", "tooth_notch", "fit")
        # a routine that searches gives no start for a third of a pixel
        assert ("otsu", "tooth_notch", "fit", "step") in found
        assert len({chain[0] for chain in found if chain[-1] == "fit"}) == 2
    dear = {**costs, "tooth_notch": 20.0}
    found = [c for c in chains(target, costs=dear) if c[-1] == "fit"]
    assert found[0] == ("ncc", "fit")


def test_a_near_target_needs_no_start(
    look: Look, register: Callable[..., None]
) -> None:
    fit = declared(kinds=("circle",), requires=("xy", "theta"), capture_px=2.0)
    register(*first(), fit=fit)
    post = look("post").target
    assert ("fit",) not in chains(post)
    assert ("fit",) in chains(replace(post, search_px=2.0))


def test_a_turned_target_needs_an_angle_to_start_from(
    look: Look, register: Callable[..., None]
) -> None:
    fit = declared(requires=("xy", "theta"), capture_px=2.0)
    register(*first(), fit=fit)
    gear = replace(look("find_gear").target, search_px=1.0)
    reach_px = gear.parameters["outer_um"] * gear.px_per_um
    near = replace(gear, theta_range_rad=1.9 / reach_px)
    far = replace(gear, theta_range_rad=2.1 / reach_px)
    assert ("fit",) in chains(near)
    assert ("fit",) not in chains(far)
    assert any(chain[-1] == "fit" for chain in chains(far))


def test_controls_are_tried_where_asked_for_only(
    look: Look, register: Callable[..., None]
) -> None:
    register(*first(), bad=declared(baseline=True))
    target = look("find_gear").target
    assert all("bad" not in chain for chain in chains(target))
    assert chains(target, controls=True) == (*chains(target), ("bad",))
    assert "bad" in routines(target, controls=True)
    assert "bad" not in routines(target)


def test_what_could_not_be_prepared_is_left_out(look: Look) -> None:
    found = chains(look("post").target, costs={"otsu": 1.0, "ncc": 12.0})
    assert set(found) == {("otsu",), ("ncc",)}
    assert chains(look("post").target, costs={}) == ()


def test_an_angle_is_told_by_a_notch_or_a_narrow_range(look: Look) -> None:
    gear = look("find_gear").target
    plain = {k: v for k, v in gear.parameters.items() if not k.startswith("notch")}
    round_gear = replace(gear, parameters=plain)
    assert has_angle(gear)
    assert not has_angle(round_gear)
    assert has_angle(replace(round_gear, theta_range_rad=math.pi / 18 - 1e-9))
    assert not has_angle(replace(round_gear, theta_range_rad=math.pi / 18))
    assert not has_angle(look("post").target)
    assert has_angle(look("bracket").target)
