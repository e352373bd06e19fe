"""Known errors of images are paid as they are, by chains on real pairs of images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.trials import PreparedRoutines, prepare
from microplan.optics.lens.lens import LensErrors
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.scene import Layer
from microplan.planner.looks.model_errors.better_models import (
    BetterModel,
    ImageModel,
    inner_weight,
)
from microplan.planner.looks.model_errors.image_pairs import image_pairs
from microplan.planner.looks.model_errors.model_cost import (
    EffectDifference,
    effect_difference,
)
from microplan.planner.looks.model_errors.pair_pictures import (
    PairPictures,
    posed_image,
)
from microplan.planner.looks.model_errors.used_poses import LEAST, used_poses
from tests.featuresel.conftest import disc, make_case, on_target

CHAIN, SEED, RADIUS_UM = ("circle_caliper",), 5, 12.0


@pytest.fixture(scope="module")
def case() -> LookCase:
    """Return a look at a round post that is stated to lie within .8 um."""
    layer = Layer(
        name="part", outline=Outline(rings=(disc(RADIUS_UM),)), z_um=0.0,
        reflectance=0.75,
    )  # fmt: skip
    found = make_case("circle", {"radius_um": RADIUS_UM}, (layer,), half_px=(24, 24))
    spread = replace(found.spread, focus_sigma_um=0.2, pose_sigma_xy_um=0.8,
                     light_gain=(1.0, 1.0), light_gradient=(0.0, 0.0),
                     search_um=3.0)  # fmt: skip
    return on_target(replace(found, spread=spread, theta_rad=0.0))


@pytest.fixture(scope="module")
def ready(case: LookCase) -> PreparedRoutines:
    return prepare(case, (CHAIN,))


def moved(case: LookCase, x_um: float, y_um: float) -> LookCase:
    """Return a look whose edges are displaced: what the cheap image does not know."""
    layers = tuple(
        replace(layer, outline=place(layer.outline, x_um, y_um))
        for layer in case.moving
    )
    return replace(case, moving=layers)


def dilated(case: LookCase, by_um: float) -> LookCase:
    return replace(case, lens=LensErrors(edge_offset_um=by_um))


def paid(
    case: LookCase, ready: PreparedRoutines, *ends: LookCase, alternates: bool = False
) -> EffectDifference:
    model = BetterModel(
        effects=("made up",), by="made up", alternates=alternates,
        ends=tuple(ImageModel(cases=((1.0, end),)) for end in ends),
    )  # fmt: skip
    trials = used_poses(case, 1.0, count=LEAST, root_seed=SEED)
    found = effect_difference(model, image_pairs(case, ready, (model,), trials))
    assert isinstance(found, EffectDifference), found
    return found


def test_a_displaced_edge_is_paid_as_far_as_it_is_displaced(
    case: LookCase, ready: PreparedRoutines
) -> None:
    found = paid(case, ready, moved(case, 0.3, -0.2)).place
    off = np.abs(found.mean - [0.3, -0.2])
    assert (off <= found.half_width).all(), found
    assert found.pairs == LEAST
    assert (found.half_width < 0.05).all()  # .3 um are far outside: no empty claim


def test_a_symmetric_error_pays_nothing(
    case: LookCase, ready: PreparedRoutines
) -> None:
    found = paid(case, ready, dilated(case, 0.4))
    assert found.image_error > 0.05  # the images differ where the edge is
    assert (np.abs(found.place.mean) <= found.place.half_width).all(), found


def test_both_ends_of_an_interval_are_within_what_is_paid(
    case: LookCase, ready: PreparedRoutines
) -> None:
    """Tried apart at half of the poses each, or both at all of them."""
    ends = (moved(case, -0.1, 0.0), moved(case, 0.5, 0.1))
    for alternates in (False, True):
        found = paid(case, ready, *ends, alternates=alternates).place
        assert found.pairs == LEAST
        for end in ((-0.1, 0.0), (0.5, 0.1)):
            assert (np.abs(found.mean - end) <= found.half_width).all()
        assert found.interval[0] == pytest.approx(0.3, abs=0.05)


def test_the_same_image_costs_nothing_at_all(
    case: LookCase, ready: PreparedRoutines
) -> None:
    found = paid(case, ready, case).place
    for values in (found.mean, found.half_width, found.sigma):
        assert (values == 0).all()


def test_a_chain_that_fails_on_better_images_is_not_paid(
    case: LookCase, ready: PreparedRoutines
) -> None:
    dark = replace(
        case, moving=tuple(replace(la, reflectance=0.1) for la in case.moving)
    )
    model = BetterModel(effects=("x",), by="", ends=(ImageModel(cases=((1.0, dark),)),))
    trials = used_poses(case, 1.0, count=LEAST, root_seed=SEED)
    answers = image_pairs(case, ready, (model,), trials)
    assert all(answer.off_um is None and answer.failure for answer in answers)
    assert isinstance(effect_difference(model, answers), str)


def test_further_chains_say_of_kept_pictures_what_they_say_of_new_ones(
    case: LookCase,
) -> None:
    others = prepare(case, (("ncc",), ("otsu", "circle_caliper")))
    ends = tuple(
        ImageModel(cases=((1.0, moved(case, x_um, 0.1)),)) for x_um in (-0.2, 0.3)
    )
    models = (
        BetterModel(effects=("x",), by="", ends=ends),
        BetterModel(effects=("y",), by="", ends=ends, alternates=True),
    )
    trials = used_poses(case, 1.0, count=4, root_seed=SEED)
    pictures = PairPictures()
    image_pairs(case, prepare(case, (CHAIN,)), models, trials[:3], known=pictures)
    assert set(pictures.made) == {0, 1, 2}
    again = image_pairs(case, others, models, trials, known=pictures)
    assert again == image_pairs(case, others, models, trials)
    # they are measured as they are kept, not made once more
    dark = {
        k: replace(each, counts=0 * each.counts) for k, each in pictures.made.items()
    }
    blind = image_pairs(case, others, models, trials, known=PairPictures(made=dark))
    assert all(answer.off_um is None for answer in blind)


def test_too_few_poses_are_refused(case: LookCase, ready: PreparedRoutines) -> None:
    model = BetterModel(effects=("x",), by="", ends=(ImageModel(cases=((1.0, case),)),))
    trials = used_poses(case, 1.0, count=LEAST, root_seed=SEED)
    answers = image_pairs(case, ready, (model,), trials)
    assert not isinstance(effect_difference(model, answers), str)
    fewer = effect_difference(model, answers[:-1])
    assert fewer == f"{LEAST - 1} of {LEAST - 1} pairs are answered, {LEAST} are needed"
    wrong = replace(answers[0], off_um=None, failure="wrong")
    assert "answered wrongly" in str(effect_difference(model, (*answers, wrong)))


def test_a_mean_of_looks_is_the_mean_of_their_images(case: LookCase) -> None:
    """Weights of a vectorial field: one is negative or beyond 1, their sum is 1."""
    trial = used_poses(case, 1.0, count=2, root_seed=SEED)[0]
    weight = inner_weight(0.42)
    assert 0 < weight < 0.2
    inner = replace(case, microscope=replace(case.microscope, aperture=0.7 * 0.42))
    made = {
        name: posed_image(each, trial, case.window)
        for name, each in (("whole", case), ("inner", inner))
    }
    change = weight * (made["inner"] - made["whole"])
    # the ledger's own prediction of it, at an edge of the step .65
    assert 0.2 * 0.0052 < np.abs(change).max() < 2 * 0.0052
