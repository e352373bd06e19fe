"""Models get more poses where what is open of their mean matters, and no others."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.featuresel.trials.chains import Chain
from microplan.optics.outline.outline import place
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.evaluation import Evaluation
from microplan.planner.looks.look_problem import Begun, CompileContext, LookProblem
from microplan.planner.looks.model_errors.better_models import BetterModel, ImageModel
from microplan.planner.looks.model_errors.chain_differences import DifferenceMeter
from microplan.planner.looks.model_errors.model_cost import EffectDifference
from microplan.planner.looks.model_errors.used_poses import LEAST
from microplan.planner.source.diagnostics import Report
from microplan.planner.views.requests import requests
from microplan.planner.views.target_views import views
from tests.planner.examples import FEW, copy_example, one_look, read

MORE = LEAST + 4
OFF_UM = 0.2


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> LookProblem:
    file = copy_example(tmp_path_factory.mktemp("look") / "task")
    one_look(file)
    task, report = read(file), Report()
    (asked,) = requests(task, unfold(task, report), 0, None)
    effort = replace(FEW, pairs=MORE)
    context = CompileContext(effort=effort, max_image_error=0.06, map=map)
    return LookProblem(task=task, request=asked, context=context, begun=Begun())


@pytest.fixture(scope="module")
def tried(problem: LookProblem) -> Evaluation:
    view = views(problem.task, problem.request, 6.9, Report())[0]
    return problem.evaluate(view)


def differences(
    problem: LookProblem, tried: Evaluation, tolerance_um: float
) -> list[tuple[int, float]]:
    """Return pairs and mean of two models for one chain: the same, and displaced."""
    off = tuple(
        replace(layer, outline=place(layer.outline, OFF_UM, 0.0))
        for layer in tried.case.moving
    )
    models = tuple(
        BetterModel(
            effects=(name,),
            by=name,
            ends=(ImageModel(cases=((1.0, replace(tried.case, moving=moving)),)),),
        )
        for name, moving in (("same", tried.case.moving), ("displaced", off))
    )
    case = replace(tried.case, tolerance_um=tolerance_um)
    chain: Chain = ("otsu",)
    meter = DifferenceMeter(problem=problem, models=models)
    found = meter.differences(replace(tried, case=case), (chain,))[chain]
    assert not isinstance(found, str), found
    return [(each.place.pairs, float(each.place.mean[0])) for each in found]


def test_only_models_that_matter_get_more_poses(
    problem: LookProblem, tried: Evaluation
) -> None:
    """Images that are the same leave nothing open, at any tolerance."""
    (none, _), (least, rough_um) = differences(problem, tried, 100.0)
    assert (least, none) == (LEAST, LEAST)
    (none, same_um), (most, close_um) = differences(problem, tried, 0.5)
    assert (most, none) == (MORE, LEAST)
    assert same_um == 0
    for mean_um in (rough_um, close_um):
        assert mean_um == pytest.approx(OFF_UM, abs=0.05)


def only(found: tuple[EffectDifference, ...] | str) -> EffectDifference:
    """Return the one effect's difference."""
    assert not isinstance(found, str), found
    (each,) = found
    return each


def test_what_one_chain_lacks_gives_another_no_more_poses(
    problem: LookProblem, tried: Evaluation
) -> None:
    off = tuple(
        replace(layer, outline=place(layer.outline, OFF_UM, 0.0))
        for layer in tried.case.moving
    )
    model = BetterModel(
        effects=("displaced",),
        by="displaced",
        ends=(ImageModel(cases=((1.0, replace(tried.case, moving=off)),)),),
    )
    case = replace(tried.case, tolerance_um=0.5)
    look, rough, fine = replace(tried, case=case), ("otsu",), ("ncc", "ecc")
    both, alone = (
        DifferenceMeter(problem=problem, models=(model,)).differences(look, chains)
        for chains in ((rough, fine), (fine,))
    )
    there, here, own = (
        only(found[chain])
        for found, chain in ((both, rough), (both, fine), (alone, fine))
    )
    assert (there.place.pairs, here.place.pairs) == (MORE, LEAST)
    assert (here.place.mean == own.place.mean).all()
    assert (here.place.half_width == own.place.half_width).all()
