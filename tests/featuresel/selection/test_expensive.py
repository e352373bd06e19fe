"""Routines that are expensive to prepare, where others leave no room."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.featuresel.routines.registry import load
from microplan.featuresel.selection.evaluate import compare_routines
from microplan.optics.render.scene import Window
from tests.featuresel.conftest import post_alone


@pytest.mark.parametrize(("in_set", "joins"), [(False, True), (True, False)])
def test_they_join_for_a_target_alone(in_set: bool, joins: bool) -> None:
    case = post_alone()
    window = Window(row=case.window.row + 50, column=case.window.column + 50,
                    rows=100, columns=100)  # fmt: skip
    target = replace(
        case.target, column=case.target.column - 50, row=case.target.row - 50
    )
    hard = replace(case, window=window, target=target, tolerance_um=0.002)
    found = compare_routines(hard, root_seed=5, most=8, limited=False, in_set=in_set)
    dear = {name for name in found.prepared.artifacts if load(name).expensive}
    assert bool(dear) == joins
    assert found.selection.chosen is None
