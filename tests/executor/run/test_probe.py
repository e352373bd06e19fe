"""The probe: it tells how the image follows the axes, and leaves all as it was."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest

from microplan.executor.devices.calibration import Calibration, ZoomPoint
from microplan.executor.devices.drivers import Counts
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.safety import PhaseLimit
from microplan.executor.devices.station import ALIGNED
from microplan.executor.run.image_jacobian import LIMIT, fit_jacobian
from microplan.executor.run.probe import axis_sigma_um, look_probed
from microplan.executor.run.run_context import Rig
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.schemas.plan import AlignAction, AxisMove, Look, Plan, Region
from microplan.schemas.pose import Pose
from tests.executor.bench import control, plan_of, step
from tests.executor.disc import REGION, PictureCamera, disc, look, noisy, rig_of

STAGE_UM = 0.05  # one sigma per axis of the simulated stage
REACH_UM = 14.0  # of the look's capture range; its rays start inside the disc
Matrix = tuple[tuple[float, float], tuple[float, float]]


def turned(angle_rad: float, scale: float = 1.0) -> Matrix:
    c, s = scale * math.cos(angle_rad), scale * math.sin(angle_rad)
    return ((c, -s), (s, c))


def twisted(cell: Cell, matrix: Matrix) -> PictureCamera:
    """Return a camera that shows the gear's true place times a matrix, as a disc."""

    def show(region: Region | None) -> Counts:
        pose = cell.truth.pose(cell.truth.bodies["gear"])
        x_um, y_um = np.array(matrix) @ (pose.x_um, pose.y_um)
        return np.rint(255 * disc(x_um, y_um)).astype(np.uint8)

    return PictureCamera(show)


def probing(
    matrix: Matrix = ((1, 0), (0, 1)),
    *,
    at: tuple[float, float] = (4.0, -3.0),
    seed: int = 1,
) -> tuple[Rig, Look, Cell]:
    """Return a rig whose gear is truly at a place, a look at it, and the cell."""
    found, artifacts = look()
    cell = build_cell(noisy(STAGE_UM), seed)
    cell.truth.bodies["gear"].pose = Pose(x_um=600.0 + at[0], y_um=at[1])
    rig = rig_of(cell, artifacts, camera=twisted(cell, matrix), probed=False)
    need = replace(rig.plan.requirements, repeatability_um={"stage": STAGE_UM})
    rig.plan = replace(rig.plan, requirements=need)
    measure = replace(found.measure, capture_um=REACH_UM)
    return rig, replace(found, measure=measure), cell


def events(rig: Rig) -> list[dict[str, object]]:
    stream = rig.journal._stream
    assert isinstance(stream, StringIO)
    return [json.loads(line) for line in stream.getvalue().splitlines()]


def named(rig: Rig, name: str) -> list[dict[str, object]]:
    return [event for event in events(rig) if event["event"] == name]


@pytest.mark.parametrize("seed", range(6))
def test_a_right_image_passes_and_the_stage_is_back(seed: int) -> None:
    rig, found, cell = probing(seed=seed)
    seen = look_probed(rig, found)
    reading = cell.station.stage.reading()
    assert (reading.x_um, reading.y_um) == (-600.0, 0.0)
    pose = cell.truth.pose(cell.truth.bodies["gear"])
    assert math.hypot(seen.x_um - pose.x_um, seen.y_um - pose.y_um) < 0.1
    (told,) = named(rig, "probe")
    assert told["looks"] == 7
    assert len(named(rig, "moved")) == 7


def test_a_zoom_is_probed_once_and_again_when_it_changes() -> None:
    rig, found, _ = probing()
    for _ in range(3):
        look_probed(rig, found)
    assert len(named(rig, "probe")) == 1
    higher = replace(found, view=replace(found.view, magnification=8.0))
    look_probed(rig, higher)
    look_probed(rig, found)  # changed back: the lens has a new error
    assert len(named(rig, "probe")) == 3


@pytest.mark.parametrize(
    ("matrix", "code", "words"),
    [
        (((-1, 0), (0, 1)), "MP833", "x is mirrored"),
        (((1, 0), (0, -1)), "MP833", "y is mirrored"),
        (((0, 1), (1, 0)), "MP833", "x and y are swapped"),
        (((0, -1), (-1, 0)), "MP833", "swapped and both reversed"),
        (((-1, 0), (0, -1)), "MP833", "turned by 180 deg"),
        (turned(math.pi / 2), "MP833", "turned by 90 deg"),
        (turned(-math.pi / 2), "MP833", "turned by -90 deg"),
        (turned(math.radians(8)), "MP833", "turned by"),
        (turned(0.0, 1.12), "MP834", "x 1.1"),
        (turned(0.0, 0.88), "MP834", "x 0.8"),
        (((1, 0), (0, 1.12)), "MP834", "y 1.1"),
    ],
)
def test_a_wrong_image_is_refused_and_named(
    matrix: Matrix, code: str, words: str
) -> None:
    rig, found, cell = probing(matrix)
    with pytest.raises(ExecutorError, match=words) as refused:
        look_probed(rig, found)
    assert refused.value.code == code
    pose = cell.truth.pose(cell.truth.bodies["gear"])
    assert math.hypot(pose.x_um, pose.y_um) <= REACH_UM  # it was never far


@pytest.mark.parametrize(
    ("matrix", "words"), [(((-1, 0), (0, 1)), "x is mirrored"), (((1, 0), (0, 1)), "")]
)
def test_a_look_that_follows_stays_where_it_is_while_a_probe_moves(
    matrix: Matrix, words: str
) -> None:
    """Else a target that goes the other way would be twice as far from its start."""
    away = (70.0, -55.0)  # all of the scene, as is believed: beyond the planned region
    rig, found, cell = probing(at=away)
    asked = set[Region]()

    def show(region: Region | None) -> Counts:
        assert region is not None
        asked.add(region)
        pose = cell.truth.pose(cell.truth.bodies["gear"])
        moved = np.array(matrix) @ (pose.x_um - away[0], pose.y_um - away[1])
        right, down = region.column - REGION.column, region.row - REGION.row
        shown = disc(away[0] + moved[0] - right, away[1] + moved[1] + down)
        return np.rint(255 * shown).astype(np.uint8)

    rig.station = replace(rig.station, camera=PictureCamera(show))
    rig.beliefs.update("gear", rig.readings(), *away, None)
    follows = replace(found, view=replace(found.view, follows=True))
    if not words:
        look_probed(rig, follows)
        assert named(rig, "probe")
    else:
        with pytest.raises(ExecutorError, match=words) as refused:
            look_probed(rig, follows)
        assert refused.value.code == "MP833"
    assert asked == {replace(REGION, column=REGION.column + 70, row=REGION.row + 55)}


def test_what_a_station_may_be_off_by_passes() -> None:
    rig, found, _ = probing(turned(0.9 * ALIGNED, 1 + 0.9 * ALIGNED))
    look_probed(rig, found)
    assert named(rig, "probe")


def test_a_calibrated_turn_is_taken_off() -> None:
    matrix = turned(math.radians(10))
    rig, found, _ = probing(matrix)
    with pytest.raises(ExecutorError, match="turned by"):
        look_probed(rig, found)
    rig, found, _ = probing(matrix)
    point = ZoomPoint(magnification=7.5, um_per_px=1.0)
    calibration = Calibration(zooms=(point,), camera_from_stage=matrix)
    offer = replace(rig.station.offer, calibration=calibration)
    rig.station = replace(rig.station, offer=offer)
    look_probed(rig, found)
    assert named(rig, "probe")


def test_a_target_that_vanishes_at_the_first_move_is_told() -> None:
    rig, found, cell = probing()

    def show(region: Region | None) -> Counts:
        pose = cell.truth.pose(cell.truth.bodies["gear"])
        image = disc(pose.x_um, pose.y_um) if abs(pose.x_um - 4) < 1 else disc(900, 0)
        return np.rint(255 * image).astype(np.uint8)

    rig.station = replace(rig.station, camera=PictureCamera(show))
    with pytest.raises(ExecutorError, match=r"lost .* \[MP82") as lost:
        look_probed(rig, found)
    assert lost.value.code == "MP835"


def test_nothing_moves_where_the_axes_scatter_too_much_to_tell() -> None:
    rig, found, cell = probing()
    need = replace(rig.plan.requirements, repeatability_um={"stage": 10.0})
    rig.plan = replace(rig.plan, requirements=need)
    look_probed(rig, found)
    (told,) = named(rig, "probe_skipped")
    assert "does not stand out" in str(told["why"])
    assert not named(rig, "move")
    assert rig.probed is None  # the next look will try again
    assert cell.station.stage.reading().x_um == -600.0


@pytest.mark.parametrize("known", [True, False])
def test_nothing_moves_near_the_fingers(known: bool) -> None:
    rig, found, _ = probing()
    if not known:  # an older plan tells no room
        rig.plan = replace(rig.plan, parts=(), fingers=())
    rig.move(AxisMove(axes="robot", y_um=0.0))  # above the gear; it is 100 um high
    rig.move(AxisMove(axes="robot", z_um=105.0))
    look_probed(rig, found)
    (told,) = named(rig, "probe_skipped")
    assert "tweezers" in str(told["why"])
    assert len(named(rig, "move")) == 2


def test_an_older_plan_is_probed_with_the_tool_away() -> None:
    rig, found, _ = probing()
    rig.plan = replace(rig.plan, parts=(), fingers=())
    look_probed(rig, found)
    assert named(rig, "probe")


def test_a_probe_keeps_to_limits_and_steps() -> None:
    rig, found, _ = probing()
    offer, rules = rig.station.offer, rig.station.rules
    narrow = replace(offer, travel={**offer.travel, "stage.x_um": (-600.0, -590.0)})
    rig.station = replace(rig.station, offer=narrow)
    look_probed(rig, found)  # the gear is at +4: inward is to lower readings
    assert "outside" in str(named(rig, "probe_skipped")[0]["why"])
    rig, found, _ = probing()
    safety = replace(rules.safety, phases={"approach": PhaseLimit(step_um=1.0)})
    rig.station = replace(rig.station, rules=replace(rules, safety=safety))
    look_probed(rig, found)
    assert "step of" in str(named(rig, "probe_skipped")[0]["why"])


def test_the_matrix_and_its_spread_are_those_of_many_draws() -> None:
    rng = np.random.default_rng(5)
    readings = [
        (0.0, 0.0),
        (8.0, 0.0),
        (8.0, 8.0),
        (20.0, 0.0),
        (-20.0, 0.0),
        (0.0, 20.0),
    ]
    true, sigma_um = np.array([[1.02, -0.3], [0.1, 0.97]]), 0.7
    drawn = []
    for _ in range(3000):
        noise = sigma_um * rng.standard_normal((len(readings), 2))
        places = np.array(readings) @ true.T + (300.0, -40.0) + noise
        told = fit_jacobian(readings, places.tolist(), sigma_um)
        drawn.append(told.matrix)
    spread = np.std(drawn, axis=0)
    # a standard deviation of 3000 draws is known to 1.3 %
    np.testing.assert_allclose(told.sigma, spread, rtol=4 * 0.013)
    error = np.abs(np.mean(drawn, axis=0) - true)
    assert (error < 4 * spread / math.sqrt(3000)).all()


def test_a_good_axis_is_refused_as_rarely_as_stated() -> None:
    # eight numbers of a probe, the averages among them: Gauss' tail at the limit
    assert 8 * math.erfc(LIMIT / math.sqrt(2)) < 1e-4


def test_scatter_that_is_not_told_is_bounded_by_the_tolerances() -> None:
    def plan(*tolerances_um: float) -> Plan:
        align = AlignAction(
            target="gear", to="goal", look="disc", axes="stage", path=()
        )
        return plan_of(
            [
                step(str(t), align, servo=control(tolerance_xy_um=t))
                for t in tolerances_um
            ]
        )

    rig, _, _ = probing()
    untold = replace(rig.plan.requirements, repeatability_um=None)
    rig.plan = replace(plan(3.0, 1.2), requirements=untold)
    assert axis_sigma_um(rig, "stage") == pytest.approx(2.0)
    assert axis_sigma_um(rig, "robot") == 0.0
