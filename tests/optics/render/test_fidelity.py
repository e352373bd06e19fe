"""The selector: what it predicts against exact images, and what it refuses."""

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.optics.oracle import Oracle
from microplan.optics.outline.outline import Outline, place
from microplan.optics.render.fidelity import LADDER, Fidelity, choose, rounded_up, steps
from microplan.optics.render.render import render
from microplan.optics.render.sampling import FAR_ERROR
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import TABLE_ERROR
from tests.optics.shapes import disc, gear, microscope, one_layer, rectangle

RIM = place(gear(), -48.0, 0.0)  # teeth in the field of a high zoom


@lru_cache(maxsize=1)  # an oracle is dear, and cases that differ in the limit share it
def _exact(
    outline: Outline, optics: Microscope, z_um: float
) -> tuple[npt.NDArray[np.float64], float]:
    """Return the true image of a white part, and how far off it may be."""
    # of errors of .0006 and more: a nearer repetition takes a third of the time
    oracle = Oracle.of(outline, optics, deepest_um=abs(z_um), wrap_error=1e-4)
    return oracle.image("exact", z_um), oracle.wrap_error


def _error(
    outline: Outline, optics: Microscope, z_um: float, fidelity: Fidelity
) -> float:
    """Return the true error of a white part's image."""
    found = render(
        one_layer(outline, z_um),
        optics,
        focus_um=0.0,
        model=fidelity.model,
        sampling=fidelity.sampling,
    )
    exact, wrap_error = _exact(outline, optics, z_um)
    return float(np.abs(found - exact).max()) - wrap_error


@pytest.mark.parametrize(
    ("magnification", "z_um"),
    [
        (6.9, 0.0),
        *(
            pytest.param(*setting, marks=pytest.mark.slow)
            for setting in (
                (6.9, 2.5),
                (6.9, 25.0),
                (44.5, 0.0),
                (44.5, 2.5),
                (44.5, 25.0),
            )
        ),
    ],
)
def test_predictions_hold_and_are_close(magnification: float, z_um: float) -> None:
    optics = microscope(magnification, 96, 72)
    part = RIM if magnification > 10 else gear()
    for limit in (0.05, 0.01, 0.002):
        found = choose(one_layer(part, z_um), optics, focus_um=(0.0,), limit=limit)
        error = _error(part, optics, z_um, found)
        assert error <= found.predicted_error <= limit
        assert found.predicted_error <= 3 * error


def test_near_focus_the_papers_law_is_refused() -> None:
    optics = microscope(44.5)
    found = choose(
        one_layer(RIM, 2.5),
        optics,
        focus_um=(0.0,),
        limit=0.01,
        ladder=("product", "exact"),
    )
    assert found.model == "exact"
    assert [r.model for r in found.refused] == ["product"]
    # the paper's law errs by .11 along straight edges, and more in corners
    assert 0.11 <= found.refused[0].predicted_error <= 0.14
    alone = choose(
        one_layer(RIM, 2.5), optics, focus_um=(0.0,), limit=0.01, ladder=("product",)
    )
    assert alone.model == "product"
    assert not alone.keeps_limit
    assert _error(RIM, optics, 2.5, alone) > 0.05


def test_far_out_of_focus_the_papers_law_will_do_for_a_loose_budget() -> None:
    found = choose(
        one_layer(gear(), 50.0),
        microscope(),
        focus_um=(0.0,),
        limit=0.05,
        ladder=("product", "exact"),
    )
    assert found.model == "product"


def test_a_tighter_limit_never_gets_a_cheaper_way() -> None:
    optics = microscope()
    before: Fidelity | None = None
    for limit in (0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4):
        found = choose(one_layer(gear(), 8.0), optics, focus_um=(0.0,), limit=limit)
        if before is not None:
            assert LADDER.index(found.model) >= LADDER.index(before.model)
            assert found.sampling.band_error <= before.sampling.band_error
            assert found.sampling.margin >= before.sampling.margin
        before = found
    assert before is not None
    assert before.model == "exact"


def test_the_choice_holds_for_every_focus() -> None:
    optics, scene = microscope(), one_layer(gear())
    near = choose(scene, optics, focus_um=(0.0,), limit=0.002)
    both = choose(scene, optics, focus_um=(0.0, -12.0), limit=0.002)
    assert near.model == "stokseth"
    assert both.model == "exact"


def test_errors_weigh_as_much_as_the_contrast() -> None:
    def predicted(reflectance: float) -> float:
        layer = Layer(name="a", outline=gear(), z_um=9.0, reflectance=reflectance)
        scene = Scene(layers=(layer,), background=0.1)
        return choose(scene, microscope(), focus_um=(0.0,), limit=0.5).predicted_error

    assert predicted(0.1) == 0
    # predictions have two digits
    assert predicted(0.2) == pytest.approx(predicted(0.9) / 8, rel=0.1)


def test_steps_are_to_what_may_lie_behind() -> None:
    layers = [
        Layer(name=name, outline=disc(5.0), z_um=z, reflectance=c)
        for name, z, c in (("low", 0.0, 0.9), ("high", 9.0, 0.5))
    ]
    assert steps(Scene(layers=tuple(layers), background=0.1)) == pytest.approx(
        (0.8, 0.4)
    )


@given(st.floats(1e-300, 1e300))
def test_rounding_up_keeps_two_digits_and_never_falls(error: float) -> None:
    found = rounded_up(error)
    # the share that a last bit may take off, and the most that two digits add
    assert error * (1 - 2e-9) <= found <= error * 1.1 * (1 + 1e-9)
    assert float(f"{found:.1e}") == pytest.approx(found, rel=1e-12)


def test_nothing_in_view_costs_nothing() -> None:
    for scene in (
        Scene(layers=(), background=0.3),
        one_layer(rectangle(-1e5, -1e5, 1e5, 1e5)),
    ):
        found = choose(scene, microscope(), focus_um=(0.0, 40.0), limit=1e-3)
        assert found.model == LADDER[0]
        # rounded up to two digits, and edges 1e5 um away
        assert found.predicted_error <= 1.1 * (TABLE_ERROR + FAR_ERROR + 2e-5)


@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan, math.inf])
def test_a_limit_that_cannot_be_is_refused(limit: float) -> None:
    with pytest.raises(ValueError, match="limit must be positive"):
        choose(one_layer(gear()), microscope(), focus_um=(0.0,), limit=limit)


def test_a_choice_needs_laws_and_a_focus() -> None:
    scene, optics = one_layer(gear()), microscope()
    with pytest.raises(ValueError, match="at least one"):
        choose(scene, optics, focus_um=(), limit=0.1)
    with pytest.raises(ValueError, match="at least one"):
        choose(scene, optics, focus_um=(0.0,), limit=0.1, ladder=())
    with pytest.raises(ValueError, match="geometric, product"):
        choose(scene, optics, focus_um=(0.0,), limit=0.1, ladder=("airy",))


@given(st.floats(1e-12, 1e6), st.sampled_from([0.0, 1e-3, 0.1]))
def test_an_error_is_never_rounded_down(error: float, finest: float) -> None:
    found = rounded_up(error, finest)
    assert found >= error * (1 - 1e-9)
    assert found <= max(1.1 * error, error + finest) * (1 + 1e-9)


def test_errors_below_the_finest_unit_are_one() -> None:
    assert rounded_up(0.01, 0.1) == rounded_up(0.012, 0.1) == 0.1
    assert rounded_up(0.0, 0.1) == 0.0
    assert rounded_up(12.3, 0.1) == 13.0
