"""What the benchmarks compare with: vectors, exact images, naive images, odds."""

from typing import Any

import numpy as np
import pytest

from benchmarks.executing.runs import NAMES, Outcome, figures
from benchmarks.optics.vectors import worst_error
from benchmarks.rivals.naive import Naive
from microplan.optics.oracle import Oracle
from microplan.optics.render.render import render
from microplan.optics.render.sampling import BAND_ERROR, margin_error
from tests.optics.shapes import gear, microscope, one_layer


def test_optics_meets_every_vector() -> None:
    # w = 1000 turns the phase by 8 pi 1000, a double holds it to 4e-13
    assert worst_error() < 1e-12


@pytest.mark.parametrize(
    "magnification", [pytest.param(6.9, marks=pytest.mark.slow), 44.5]
)
def test_the_renderer_meets_the_oracle(magnification: float) -> None:
    optics = microscope(magnification)  # the gear is larger than the frame at 44.5
    exact = Oracle.of(gear(), optics, wrap_error=1e-4).image("exact", 10.0)
    found = render(one_layer(gear(), 10.0), optics, focus_um=0.0)
    np.testing.assert_allclose(found, exact, rtol=0, atol=BAND_ERROR + margin_error())


@pytest.mark.parametrize("z_um", [0.0, 20.0])
def test_the_naive_script_shows_the_same_gear(z_um: float) -> None:
    optics = microscope()
    ours = render(one_layer(gear(), z_um), optics, focus_um=0.0)
    naive = Naive(outline=gear(), microscope=optics).image(z_um)
    # rounding and dilation move an edge by a raster step at most; the steepest edge
    # rises by twice the integral of T over the band, 8 / (3 pi) of the cutoff
    steepest_per_um = 8 / (3 * np.pi) * optics.cutoff_per_um
    step_um = optics.um_per_px / np.ceil(optics.um_per_px / 0.3)
    assert np.abs(naive - ours).max() < step_um * steepest_per_um
    # which is one row of pixels along the outline
    share = gear().perimeter_um * step_um / np.prod(optics.field_um)
    assert np.abs(naive - ours).mean() < share


def outcome(seed: int, *, done: bool, seated: bool) -> Outcome:
    """Return a run that ended `seed` nm off, or that never let go, 1 mm off."""
    return Outcome(
        seed=seed, done=done, seated=seated, put_down=done or seated,
        offset_um=seed / 1000 if done or seated else 1000.0, time_s=30.0, cycles=3,
    )  # fmt: skip


def plan(chance: float) -> Any:
    """Return as much of a plan as the figures are compared with."""
    insert = {
        "rows": [{"sigma_um": 0.5}],
        "analysis": {"covariance_um2": [0.1, 0.0, 0.1]},
    }
    control = {"tolerance_xy_um": 1.0, "expected_cycles": 2.5}
    return {
        "success_probability": chance,
        "steps": [
            {"verb": "align", "control": control},
            {"verb": "insert", "control": None, "budget": insert},
        ],
    }


def test_final_errors_are_those_of_parts_that_were_let_go() -> None:
    runs = [outcome(i, done=True, seated=True) for i in range(100)]
    runs += [outcome(i, done=False, seated=False) for i in range(100, 110)]
    found = {figure.name: figure.value for figure in figures(runs, plan(0.9))}
    assert found["executor.final_error_p95_um"] == pytest.approx(0.09405)
    assert found["executor.final_error_p95_lower_um"] < 0.09405
    assert found["executor.final_error_p95_upper_um"] == pytest.approx(0.099)
    assert found["executor.cycles_predicted"] == 2.5


def test_success_is_judged_by_the_cell_and_not_by_the_executor() -> None:
    ends = (
        [(True, True)] * 96 + [(True, False)] + [(False, True)] + [(False, False)] * 2
    )
    outcomes = [outcome(i, done=d, seated=s) for i, (d, s) in enumerate(ends)]
    found = {figure.name: figure.value for figure in figures(outcomes, plan(0.97))}
    assert tuple(found) == NAMES
    assert found["executor.success"] == 0.97
    assert found["executor.false_done"] == 1
    assert found["executor.failed_aloud"] == 3
    assert found["executor.success_p_value"] == 1.0


def test_a_prediction_far_off_is_refuted() -> None:
    outcomes = [outcome(i, done=True, seated=i % 10 > 0) for i in range(200)]
    found = {figure.name: figure.value for figure in figures(outcomes, plan(0.99))}
    # Poisson with mean 2: 20 failures have 2**20 e**-2 / 20! = 6e-14
    assert found["executor.success_p_value"] < 1e-12
