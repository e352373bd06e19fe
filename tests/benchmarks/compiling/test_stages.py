"""The compile benchmark: stages that exist, figures under the names it says."""

from __future__ import annotations

import importlib

import pytest

from benchmarks.compiling.stages import (
    BENCHMARK,
    PRESETS,
    RENDERERS,
    STAGES,
    Spent,
    figures,
)


@pytest.mark.parametrize(
    "place",
    [
        *STAGES.values(),
        *(("microplan.featuresel.look.scenario", name) for name in RENDERERS),
    ],
)
def test_every_stage_is_called_where_it_is_timed(place: tuple[str, str]) -> None:
    module, name = place
    assert callable(getattr(importlib.import_module(module), name))


def test_figures_have_the_names_of_the_benchmark() -> None:
    found = Spent(
        total_s=9.0,
        stages_s=dict.fromkeys(STAGES, 1.0),
        images=[(9, 8, 5), (7, 8, 2)],
        optics_share=0.5,
    )
    made = [figure for preset in PRESETS for figure in figures(preset, found, 3.0)]
    assert tuple(figure.name for figure in made) == BENCHMARK.names
    assert made[0].form()["ratio_floor"] == 3.0
    assert [figure.value for figure in made[len(STAGES) + 1 :][:2]] == [7, 0.5]
