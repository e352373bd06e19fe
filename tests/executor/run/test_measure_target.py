"""A look: pixels to um, gates, fallback and retries."""

from __future__ import annotations

import io
import itertools
import json
import math
from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.executor.devices.drivers import Counts
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.record.write_ahead_log import Journal
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.run.measure_target import light_of, look_at, look_near
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated.cell import build_cell
from microplan.featuresel.routines.contract import (
    Artifact,
    LookModel,
    Nuisances,
    Target,
)
from microplan.featuresel.routines.template import ncc
from microplan.optics.lens.response import Response, power_rows
from microplan.schemas.plan import Gates, Look, OnFailure, Region, RoutineUse
from microplan.schemas.plan.views import CoarseFirst
from microplan.schemas.pose import Pose
from tests.executor.bench import plan_of
from tests.executor.disc import (
    CENTER,
    PITCH_UM,
    RADIUS_UM,
    REGION,
    PictureCamera,
    disc,
    look,
    noisy,
    quiet_cell,
    rig_of,
)


def blinking(rig: Rig, dark: int) -> PictureCamera:
    """Return the rig's camera, but that its first frames are dark."""
    camera, frames = rig.station.camera, itertools.count()

    def show(region: Region | None) -> Counts:
        counts = camera.grab(region, after_s=0.0).counts
        return np.zeros_like(counts) if next(frames) < dark else counts

    return PictureCamera(show)


def seeing(x_um: float, y_um: float) -> tuple[Rig, Look]:
    """Return a rig whose gear is believed at the origin and is at (x, y)."""
    cell = quiet_cell()
    cell.truth.bodies["gear"].pose = Pose(x_um=600.0 + x_um, y_um=y_um)
    found, artifacts = look()
    return rig_of(cell, artifacts), found


def gated(found: Look, gates: Gates) -> Look:
    return replace(found, measure=replace(found.measure, gates=gates))


def test_a_sighting_is_in_um_of_the_world_with_y_up() -> None:
    rig, found = seeing(7.25, -3.5)
    seen = look_at(rig, found)
    assert (seen.x_um, seen.y_um) == pytest.approx((7.25, -3.5), abs=0.02)
    at = rig.beliefs.world("gear", rig.readings())
    assert (at.x_um, at.y_um) == pytest.approx((seen.x_um, seen.y_um))


def test_the_bias_is_taken_off_in_the_targets_frame() -> None:
    rig, found = seeing(0.0, 0.0)
    plain = look_at(rig, found)
    rig.beliefs.update("gear", rig.readings(), 0.0, 0.0, math.pi / 2)
    biased = replace(found, measure=replace(found.measure, bias_um=(2.0, 0.5)))
    seen = look_at(rig, biased)
    # turned by a quarter, (2, .5) is (-.5, 2)
    assert seen.x_um - plain.x_um == pytest.approx(0.5)
    assert seen.y_um - plain.y_um == pytest.approx(-2.0)


def test_a_bias_is_left_alone_at_an_unknown_angle() -> None:
    rig, found = seeing(0.0, 0.0)
    plain = look_at(rig, found)  # the gear lies at any angle, and none is measured
    biased = replace(found, measure=replace(found.measure, bias_um=(2.0, 0.5)))
    seen = look_at(rig, biased)
    at = (plain.x_um, plain.y_um)
    assert (seen.x_um, seen.y_um) == pytest.approx(at, abs=1e-6)


def test_a_look_that_follows_reads_its_region_about_the_believed_target() -> None:
    """The planned region ends 48 um from the middle; at the frame's rim it stays."""
    asked = []

    def show(region: Region | None) -> Counts:
        assert region is not None
        asked.append(region)
        x_um, y_um = there_um[0] + REGION.column, there_um[1] - REGION.row
        shown = disc(x_um - region.column, y_um + region.row)
        return np.rint(255 * shown).astype(np.uint8)

    for believed_um, off_px in (
        ((80.3, -60.4), (80, 60)),
        ((-300.0, 0.0), (-REGION.column, 0)),
    ):
        there_um = (believed_um[0] + 3.0, believed_um[1] - 2.0)
        rig, found = seeing(*there_um)
        rig.station = replace(rig.station, camera=PictureCamera(show))
        rig.beliefs.update("gear", rig.readings(), *believed_um, None)
        follows = replace(found, view=replace(found.view, follows=True))
        seen = look_at(rig, follows)
        assert (seen.x_um, seen.y_um) == pytest.approx(there_um, abs=0.02)
        column, row = REGION.column + off_px[0], REGION.row + off_px[1]
        assert asked[-1] == replace(REGION, column=column, row=row)


@pytest.mark.parametrize(
    ("believed_um", "there_um"),
    [
        ((0.0, 0.0), (6.0, -6.0)),
        ((11.0, 0.0), (17.0, 3.0)),
        ((8.0, -9.0), (4.0, -14.0)),
    ],
)
def test_a_look_searches_about_where_its_target_is_believed(
    believed_um: tuple[float, float], there_um: tuple[float, float]
) -> None:
    rig, found = searching(8.0, there_um)
    rig.beliefs.update("gear", rig.readings(), *believed_um, None)
    seen = look_at(rig, found)
    assert (seen.x_um, seen.y_um) == pytest.approx(there_um, abs=0.1)


def test_a_target_beyond_the_search_is_not_found() -> None:
    rig, found = searching(8.0, (12.0, 0.0))
    rig.beliefs.update("gear", rig.readings(), 1.0, 0.0, None)
    with pytest.raises(ExecutorError, match="at the search's rim") as caught:
        look_at(rig, found)
    where = "it is looked for within 25 um of (1.0, 0.0) um, where it is believed"
    assert caught.value.message.endswith(where)
    assert caught.value.code == "MP820"


class Drawn:
    """The disc for a routine that is prepared."""

    nuisances = Nuisances(
        focus_sigma_um=0.0, zoom_sigma=0.0, gradient=0.0, axis_px=CENTER
    )

    def __call__(
        self, *, dx_um: float = 0.0, dy_um: float = 0.0, theta_rad: float = 0.0
    ) -> FloatArray:
        return disc(dx_um, dy_um)


def searching(search_um: float, there_um: tuple[float, float]) -> tuple[Rig, Look]:
    """Return a rig and a look that correlates within `search_um` of a start."""
    rig, found = seeing(*there_um)
    target = Target(
        name="gear",
        kind="circle",
        column=CENTER[0],
        row=CENTER[1],
        theta_rad=0.0,
        px_per_um=1 / PITCH_UM,
        search_px=search_um / PITCH_UM,
        theta_range_rad=math.pi,
        symmetry=1,
        bright=True,
        parameters={"radius_um": RADIUS_UM},
    )
    artifact = ncc.prepare(cast(LookModel, Drawn()), target)
    assert isinstance(artifact, Artifact)
    use = RoutineUse(
        id="ncc", version=ncc.NCC.version, parameters=artifact.parameters, arrays=None
    )
    rig.artifacts = Artifacts({("disc", "ncc"): artifact})
    return rig, replace(found, measure=replace(found.measure, chain=(use,)))


@pytest.mark.parametrize(
    ("gates", "code"),
    [
        (Gates(min_score=1.01, max_shift_um=60.0, max_turn_rad=None), "MP821"),
        (Gates(min_score=0.3, max_shift_um=4.0, max_turn_rad=None), "MP822"),
    ],
)
def test_a_gate_refuses_and_leaves_the_belief_alone(gates: Gates, code: str) -> None:
    rig, found = seeing(5.0, 0.0)
    with pytest.raises(ExecutorError) as caught:
        look_at(rig, gated(found, gates))
    assert caught.value.code == code
    assert rig.beliefs.world("gear", rig.readings()).x_um == 0.0


def test_a_failure_is_tried_again_as_often_as_the_plan_says() -> None:
    rig, found = seeing(1.0, 0.0)
    rig.station = replace(rig.station, camera=blinking(rig, 2))
    seen = look_at(rig, found, (OnFailure(code="MP820", do="retry", times=2),))
    assert seen.frames == 3
    rig.station = replace(rig.station, camera=blinking(rig, 2))
    with pytest.raises(ExecutorError, match="gear not found"):
        look_at(rig, found, (OnFailure(code="MP820", do="retry", times=1),))


@pytest.mark.parametrize(("level", "light"), [(3, False), (20, True), (255, True)])
def test_a_dark_picture_is_told_from_one_without_the_part(
    level: int, light: bool
) -> None:
    rig, found = seeing(1.0, 0.0)
    shape = rig.station.camera.grab(found.measure.region, after_s=0.0).counts.shape
    flat = PictureCamera(lambda _: np.full(shape, level, dtype=np.uint8))
    rig.station = replace(rig.station, camera=flat)
    with pytest.raises(ExecutorError) as caught:
        look_at(rig, found)
    assert f"has {level / 255:.1%} of full scale" in caught.value.message
    assert ("is the light on?" in caught.value.message) != light


def test_a_retry_may_be_keyed_by_the_routines_own_code() -> None:
    rig, found = seeing(1.0, 0.0)
    rig.station = replace(rig.station, camera=blinking(rig, 1))
    assert look_at(rig, found, (OnFailure(code="no_edge", do="retry"),)).frames == 2


def test_a_failing_chain_hands_over_to_the_fallback() -> None:
    rig, found = seeing(1.0, 0.0)
    good = found.measure.chain[0]
    _, artifacts = look()
    ((_, artifact),) = artifacts.stages("disc", (good,))
    wrong = Artifact(parameters={**artifact.parameters, "seen_px": 12.0})
    first = RoutineUse(
        id="circle_caliper", version="1", parameters={}, arrays="wrong.npz"
    )
    rig.artifacts = Artifacts(
        {("disc", "wrong.npz"): wrong, ("disc", "circle_caliper"): artifact}
    )
    both = replace(found, measure=replace(found.measure, chain=(first,)))
    with pytest.raises(ExecutorError, match="gear not found") as caught:
        look_at(rig, both)
    assert caught.value.cause in str(caught.value)
    assert caught.value.code == "MP820"
    both = replace(both, measure=replace(both.measure, fallback=(good,)))
    assert look_at(rig, both).x_um == pytest.approx(1.0, abs=0.02)


def test_the_view_is_set_only_where_it_changes() -> None:
    rig, found = seeing(0.0, 0.0)
    rig.view = None  # nothing was set before
    stream = io.StringIO()
    rig.journal = Journal(stream, rig.station.clock)
    look_at(rig, found)
    look_at(rig, found)
    lower = replace(found, view=replace(found.view, focus_um=-5.0))
    look_at(rig, lower)
    names = [json.loads(line)["event"] for line in stream.getvalue().splitlines()]
    assert names.count("zoom") == 1
    assert names.count("focus") == 2


def test_a_camera_of_another_size_is_a_device_fault() -> None:
    cell = build_cell(noisy(0.0), 1)
    rig = rig_of(cell, look()[1])
    rig.station = cell.station
    small = Region(row=0, column=0, rows=12, columns=17)
    assert rig.grab(small).shape == (12, 17)
    need = replace(rig.plan.requirements, width_px=641)
    rig.plan = replace(rig.plan, requirements=need)
    with pytest.raises(ExecutorError, match="640") as caught:
        rig.grab(None)
    assert caught.value.code == "MP841"


@pytest.mark.parametrize("bits", [8, 12])
def test_full_scale_is_one(bits: int) -> None:
    counts = np.array([[0, 2**bits - 1]], dtype=np.uint16)
    need = replace(plan_of(()).requirements, bits=bits)
    np.testing.assert_array_equal(light_of(counts, need), [[0.0, 1.0]])


def test_counts_go_back_through_the_response() -> None:
    """Of black at 10 counts, half the light at 210 and white at 250."""
    curve = ((0.0, 10.0), (0.5, 210.0), (1.0, 250.0))
    need = replace(plan_of(()).requirements, response=curve)
    counts = np.array([[6, 10, 110, 210, 230, 250, 255]], dtype=np.uint8)
    light = [[-0.01, 0.0, 0.25, 0.5, 0.75, 1.0, 1.0]]
    np.testing.assert_allclose(light_of(counts, need), light, atol=1e-15)


@pytest.mark.parametrize("gamma", [0.45, 2.2])
@pytest.mark.parametrize("black", [-6.0, 0.0, 12.5])
def test_runs_take_counts_for_the_light_that_trials_took(
    gamma: float, black: float
) -> None:
    """The runtime has no optics: it has the formula once more."""
    response = Response.from_levels(power_rows(gamma), black=black, white=247.0)
    need = replace(plan_of(()).requirements, response=response.rows)
    counts = np.arange(256, dtype=np.uint8)
    np.testing.assert_allclose(
        light_of(counts, need), response.share_of(counts.astype(float)), atol=1e-15
    )


def test_a_picture_that_is_cut_off_everywhere_has_no_light() -> None:
    rig, found = seeing(1.0, 0.0)
    curve = ((0.0, -30.0), (1.0, 255.0))
    need = replace(rig.plan.requirements, response=curve)
    rig.plan = replace(rig.plan, requirements=need)
    shape = rig.station.camera.grab(found.measure.region, after_s=0.0).counts.shape
    dark = PictureCamera(lambda _: np.zeros(shape, dtype=np.uint8))
    rig.station = replace(rig.station, camera=dark)
    with pytest.raises(ExecutorError, match=r"is the light on\?"):
        look_at(rig, found)


@pytest.mark.parametrize(
    "curve",
    [
        ((0.0, 5.0),),
        ((0.0, 5.0), (1.0, 5.0)),
        ((0.0, 9.0), (1.0, 5.0)),
        ((0.0, 5.0), (1.0, math.inf)),
    ],
)
def test_a_plans_response_rises(curve: tuple[tuple[float, float], ...]) -> None:
    with pytest.raises(ValueError, match="response must rise"):
        replace(plan_of(()).requirements, response=curve)


OFF = (8.0, -5.0)  # of the gear from where it is believed to be


def in_two(most_um: float = 40.0) -> tuple[Rig, io.StringIO, tuple[Look, Look]]:
    """Return a rig, its journal, and a coarse and a fine look at its gear, `OFF`."""
    rig, plain = seeing(*OFF)
    stream = io.StringIO()
    rig.journal = Journal(stream, rig.station.clock)
    way = CoarseFirst(look="wide", axes="stage", at_um=(1.5, 0.5), most_um=most_um)
    fine = replace(
        gated(plain, Gates(min_score=0.3, max_shift_um=0.2, max_turn_rad=None)),
        coarse=way,
    )
    coarse = replace(plain, id="wide")
    found, artifacts = look()
    ((_, artifact),) = artifacts.stages("disc", found.measure.chain)
    rig.artifacts = Artifacts(
        {("disc", "circle_caliper"): artifact, ("wide", "circle_caliper"): artifact}
    )
    return rig, stream, (coarse, fine)


def test_a_coarse_look_tells_the_fine_one_where_to_expect_its_target() -> None:
    rig, stream, (coarse, fine) = in_two()
    with pytest.raises(ExecutorError) as caught:
        look_at(rig, fine)  # its gate is .2 um: alone it finds the gear too far off
    assert caught.value.code == "MP822"
    before = rig.station.stage.reading()
    seen = look_near(rig, (coarse, fine), fine)
    assert (seen.x_um, seen.y_um) == pytest.approx((1.5, 0.5), abs=0.02)
    assert rig.station.stage.reading() == before
    at = rig.beliefs.world("gear", rig.readings())
    assert (at.x_um, at.y_um) == pytest.approx(OFF, abs=0.02)
    events = [json.loads(line) for line in stream.getvalue().splitlines()][2:]
    done = [e["event"] for e in events if e["event"] in ("look", "seen", "move")]
    assert done == ["look", "seen", "move", "look", "seen", "move"]
    there = next(e["to"] for e in events if e["event"] == "move")
    moved = (there["x_um"] - before.x_um, there["y_um"] - before.y_um)
    assert moved == pytest.approx((1.5 - OFF[0], 0.5 - OFF[1]), abs=0.02)
    assert there["z_um"] is there["theta_rad"] is None


def test_a_target_too_far_off_is_not_brought() -> None:
    rig, _, (coarse, fine) = in_two(most_um=8.0)
    before = rig.station.stage.reading()
    with pytest.raises(ExecutorError, match="may bring it 8 um") as caught:
        look_near(rig, (coarse, fine), fine)
    assert caught.value.code == "MP832"
    assert rig.station.stage.reading() == before


def test_nothing_is_brought_that_the_coarse_look_did_not_find() -> None:
    rig, _, (coarse, fine) = in_two()
    before = rig.station.stage.reading()
    rig.station = replace(rig.station, camera=blinking(rig, 9))
    with pytest.raises(ExecutorError, match="look wide") as caught:
        look_near(rig, (coarse, fine), fine)
    assert caught.value.code == "MP820"
    assert rig.station.stage.reading() == before
    with pytest.raises(ExecutorError, match="'wide'") as caught:
        look_near(rig, (fine,), fine)
    assert caught.value.code == "MP802"


def test_a_look_without_a_coarse_one_is_a_look() -> None:
    rig, found = seeing(1.0, 0.0)
    assert look_near(rig, (found,), found).x_um == pytest.approx(1.0, abs=0.02)
