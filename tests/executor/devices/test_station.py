"""Preflight refuses what the station cannot do, each with its own code."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import replace

import pytest

from microplan.executor.devices.drivers import AxisReading
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.loading import check_role
from microplan.executor.devices.station import Station, preflight
from microplan.executor.simulated.cell import build_cell
from microplan.schemas.plan import Plan, Reason
from tests.executor.bench import plan_of, quiet, stage_start, world


def station() -> Station:
    return build_cell(quiet(world()), 0).station


def displaced(x_um: float) -> Station:
    """Return a station whose stage stands at `x_um`."""
    cell = build_cell(quiet(world()), 0)
    cell.stage.move(x_um=x_um)
    return cell.station


def needing(**changes: object) -> Plan:
    """Return a plan whose requirements are changed."""
    plan = plan_of(())
    need = replace(plan.requirements, **changes)  # type: ignore[arg-type]  # by name
    return replace(plan, requirements=need)


def test_the_examples_plan_fits_the_examples_cell_and_nothing_moves() -> None:
    found = station()
    before = found.stage.reading(), found.jaws().reading()
    preflight(plan_of(()), found)
    assert (found.stage.reading(), found.jaws().reading()) == before
    assert before[0].x_um == stage_start().x_um


def test_limits_belong_to_what_is_reachable() -> None:
    """A plan that asks for all the station offers fits; a micrometre more does not."""
    found = station()
    offer = found.offer
    assert offer.opening_um is not None
    whole = {"magnification": offer.magnification, "focus_um": offer.focus_um,
             "opening_um": offer.opening_um, "travel": offer.travel}  # fmt: skip
    preflight(needing(**whole), found)
    low, high = offer.focus_um
    with pytest.raises(ExecutorError, match="focus_um") as caught:
        preflight(needing(focus_um=(low, high + 1.0)), found)
    assert caught.value.code == "MP806"


@pytest.mark.parametrize(
    ("plan", "code", "message"),
    [
        (needing(width_px=1280), "MP805", "width_px = 1280, the camera has 640"),
        (needing(pitch_um=7.4), "MP805", "pitch_um = 7.4"),
        (needing(bits=12), "MP805", "bits = 12"),
        (needing(magnification=(2.0, 6.9)), "MP806", "magnification 2..6.9"),
        (needing(focus_um=(0.0, 900.0)), "MP806", "focus_um 0..900"),
        (needing(opening_um=(50.0, 130.0)), "MP807", "opening_um 50..130"),
        (needing(travel={"stage.x_um": (-9e3, 0.0)}), "MP808", "stage.x_um -9000..0"),
        (needing(travel={"stage.tip": (0.0, 1.0)}), "MP808", "no axis stage.tip"),
        (needing(theta_axis_um=(5.0, 0.0)), "MP809", "turns about"),
    ],
)
def test_a_requirement_that_is_not_met_is_refused(
    plan: Plan, code: str, message: str
) -> None:
    with pytest.raises(ExecutorError, match=message) as caught:
        preflight(plan, station())
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda s: replace(s, robot=None), "MP808"),
        (lambda s: replace(s, offer=replace(s.offer, opening_um=None)), "MP807"),
    ],
)
def test_a_missing_device_is_refused(
    change: Callable[[Station], Station], code: str
) -> None:
    with pytest.raises(ExecutorError) as caught:
        preflight(plan_of(()), change(station()))
    assert caught.value.code == code


def test_an_infeasible_plan_is_refused_with_its_reasons() -> None:
    reason = Reason(code="MP401", step="find_gear", message="too large")
    plan = replace(plan_of(()), status="infeasible", reasons=(reason,))
    with pytest.raises(ExecutorError, match="MP401 in find_gear: too large") as caught:
        preflight(plan, station())
    assert (caught.value.code, caught.value.exit_status) == ("MP801", 1)


def test_a_sketch_is_refused_and_sent_to_be_compiled() -> None:
    plan = replace(plan_of(()), status="sketch")
    with pytest.raises(ExecutorError, match="compile it") as caught:
        preflight(plan, station())
    assert (caught.value.code, caught.value.exit_status) == ("MP817", 1)


def test_a_station_that_is_somewhere_else_is_refused() -> None:
    with pytest.raises(ExecutorError, match=r"stage.x_um reads -590") as caught:
        preflight(plan_of(()), displaced(-590.0))
    assert caught.value.code == "MP811"
    start_um = stage_start().x_um
    assert start_um is not None
    preflight(plan_of(()), displaced(start_um))


def test_a_station_may_read_what_its_axes_settle_within() -> None:
    start_um = stage_start().x_um
    assert start_um is not None
    window_um = station().rules.settle("stage").window_um
    preflight(plan_of(()), displaced(start_um + 0.9 * window_um))
    with pytest.raises(ExecutorError) as caught:
        preflight(plan_of(()), displaced(start_um + 1.5 * window_um))
    assert caught.value.code == "MP811"


def raises() -> AxisReading:
    raise RuntimeError("no carrier")


def hangs() -> AxisReading:
    threading.Event().wait(5.0)
    raise TimeoutError


def is_nan() -> AxisReading:
    return AxisReading(x_um=math.nan, y_um=0.0, z_um=0.0, theta_rad=0.0)


@pytest.mark.parametrize(
    ("reading", "code"), [(raises, "MP841"), (hangs, "MP844"), (is_nan, "MP847")]
)
def test_a_device_that_cannot_be_read_is_no_bug(
    reading: Callable[[], AxisReading], code: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = station()
    quick = replace(found.rules, safety=replace(found.rules.safety, call_s=0.1))
    monkeypatch.setattr(found.stage, "reading", reading)
    with pytest.raises(ExecutorError) as caught:
        preflight(plan_of(()), replace(found, rules=quick))
    assert caught.value.code == code


def test_a_device_whose_serial_number_cannot_be_read_is_told() -> None:
    class Silent:
        @property
        def model(self) -> str:
            raise OSError("no answer")

    with pytest.raises(ExecutorError, match=r"light\.model: OSError: no") as told:
        check_role(Silent(), "light", "light")
    assert told.value.code == "MP813"
