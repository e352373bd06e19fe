"""`microplan tradeoff`: what it measures, writes and shows."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.optics.oracle import oracle_image
from microplan.optics.render.fidelity import choose
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.transfer.models import MODELS
from microplan.planner.assembly.step_states import unfold
from microplan.planner.cli.main import main
from microplan.planner.looks import scenario as cases
from microplan.planner.source.diagnostics import Report
from microplan.planner.tradeoff import reference_images as truths
from microplan.planner.tradeoff import render_methods as ways
from microplan.planner.tradeoff.plots import Strip, round_down, strip_png, tradeoff_png
from microplan.planner.tradeoff.reference_images import (
    ReferenceView,
    exact_reference,
    traced_reference,
)
from microplan.planner.tradeoff.render_methods import front, measure
from microplan.planner.tradeoff.tradeoff import FOCUS_SIGMAS, strip_of
from microplan.planner.tradeoff.tradeoff_record import (
    MeasuredMethod,
    StepTradeoff,
    Tradeoff,
)
from microplan.planner.views.requests import requests
from microplan.planner.views.target_views import views
from microplan.schemas.codec import from_data
from tests.optics.shapes import disc, microscope, one_layer, rectangle
from tests.planner.examples import EXAMPLE, ROOT, copy_example, one_look, read

TASK = str(EXAMPLE / "task.yaml")
LIMIT = 0.0015  # between what `exact` and `hopkins` err where the task's post is
FRAME = Window(row=6, column=8, rows=20, columns=24)
SMALL = microscope(6.9, 40, 32)


@pytest.fixture(scope="module")
def task_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a task of one look at a post, with the stage around it in view."""
    file = copy_example(tmp_path_factory.mktemp("tradeoff") / "task")
    one_look(file)
    return file


@pytest.fixture(scope="module")
def said(task_file: Path) -> str:
    """Return what the command prints when it writes to its default place."""
    old = task_file.parent / "gear-on-shaft.tradeoff"
    old.mkdir()
    (old / "tradeoff.csv").write_text("old", encoding="utf-8")
    stream = io.StringIO()
    with contextlib.redirect_stdout(stream):
        limit = ("--max-image-error", str(LIMIT))
        assert main(["tradeoff", str(task_file), "--step", "see_post", *limit]) == 0
    return stream.getvalue()


@pytest.fixture(scope="module")
def folder(task_file: Path, said: str) -> Path:
    """Return where the files are, as the command has said."""
    assert said.endswith(f"folder: {task_file.parent / 'gear-on-shaft.tradeoff'}\n")
    return task_file.parent / "gear-on-shaft.tradeoff"


@pytest.fixture(scope="module")
def record(folder: Path) -> Tradeoff:
    data = json.loads((folder / "tradeoff.json").read_text(encoding="utf-8"))
    return from_data(Tradeoff, data)


@pytest.fixture
def step(record: Tradeoff) -> StepTradeoff:
    (only,) = record.steps
    return only


def sight_of(scene: Scene, *focus_um: float) -> ReferenceView:
    return ReferenceView(scene=scene, microscope=SMALL, window=FRAME, focus_um=focus_um)


def two_discs() -> Scene:
    """Return a disc over the edge of a wider one, 15 um below it."""
    return Scene(
        layers=(
            Layer(name="low", outline=disc(9.0), z_um=-15.0, reflectance=0.3),
            Layer(name="high", outline=disc(7.0), z_um=0.0, reflectance=0.9),
        ),
        background=0.1,
    )


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "tradeoff.csv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def decoded(data: bytes) -> npt.NDArray[np.uint8]:
    found = cv2.imdecode(np.frombuffer(data, "u1"), cv2.IMREAD_COLOR)
    assert found is not None
    return found.astype(np.uint8)


def test_the_files_are_there(folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == [
        "strip-see_post.png",
        "tradeoff-see_post.png",
        "tradeoff.csv",
        "tradeoff.json",
    ]


def test_the_record_says_what_its_times_depend_on(record: Tradeoff) -> None:
    assert record.format_version == "1.0"
    assert record.task == "gear-on-shaft"
    assert "depend on the machine" in record.note
    assert record.numpy == np.__version__
    assert record.machine.startswith(("Linux", "Darwin", "Windows"))


def test_the_table_holds_every_way_of_the_record(
    folder: Path, step: StepTradeoff
) -> None:
    rows = rows_of(folder)
    assert len(rows) == len(step.ways)
    for row, way in zip(rows, step.ways, strict=True):
        assert row["step"] == "see_post"
        assert row["model"] == way.model
        # both have six digits
        assert float(row["time_ms"]) == pytest.approx(way.time_ms, rel=1e-5)
        assert float(row["max_error"]) == pytest.approx(way.max_error, rel=1e-5)
        assert row["law_max_error"] == "" or way.law_max_error is not None
        assert int(row["is_choice"]) == way.is_choice


def test_the_page_documents_every_field() -> None:
    page = (ROOT / "docs" / "tradeoff.md").read_text(encoding="utf-8")
    documented = set(re.findall(r"`(\w+)`", page.partition("## Fields")[2]))
    for kind in (Tradeoff, StepTradeoff, MeasuredMethod):
        assert {field.name for field in fields(kind)} <= documented
    for name in re.findall(r"\((images/[^)]+)\)", page):
        assert decoded((ROOT / "docs" / name).read_bytes()).std() > 20


def test_every_law_meets_every_sampling_and_treatment(step: StepTradeoff) -> None:
    keys = {
        model: {
            (w.band_error, w.margin, w.float_bits, w.rays_per_cell)
            for w in step.ways
            if w.model == model
        }
        for model in MODELS
    }
    assert len({frozenset(found) for found in keys.values()}) == 1
    found = keys["exact"]
    assert {rays for *_, rays in found} == {0, *ways.RAYS}
    assert {bits for _, _, bits, _ in found} == {32, 64}
    assert {(b, m, 64, 0) for b in ways.BANDS for m in ways.MARGINS} <= found


def test_errors_and_times_are_positive_and_ordered(step: StepTradeoff) -> None:
    assert step.floor_ms > 0
    for way in step.ways:
        assert way.time_ms > 0
        assert 0 < way.rms_error < way.max_error < 1
        if way.law_max_error is not None and way.law_rms_error is not None:
            assert 0 < way.law_rms_error < way.law_max_error < 1


def test_no_way_is_faster_than_one_transform_pair(step: StepTradeoff) -> None:
    assert min(way.time_ms for way in step.ways) >= step.floor_ms


def test_errors_fall_with_finer_sampling(step: StepTradeoff) -> None:
    error = {
        (way.band_error, way.margin): way.law_max_error or 0.0
        for way in step.ways
        if way.model == "exact" and way.float_bits == 64 and not way.rays_per_cell
    }
    for margin in ways.MARGINS:
        by_band = [error[band, margin] for band in sorted(ways.BANDS, reverse=True)]
        # the last part of the band may be less than what the margin costs
        assert by_band[0] > by_band[1] >= by_band[2] - step.law_oracle_error
    for band in ways.BANDS:
        assert error[band, 40.0] < error[band, 10.0]


def test_no_law_beats_the_exact_one_by_more_than_its_sampling(
    step: StepTradeoff,
) -> None:
    best = {
        model: min(
            way.law_max_error
            for way in step.ways
            if way.model == model and way.law_max_error is not None
        )
        for model in MODELS
    }
    assert best["exact"] < best["hopkins"] < best["product"] < best["geometric"]


def test_the_choice_keeps_its_limit_and_its_prediction(step: StepTradeoff) -> None:
    assert [way.is_choice for way in step.ways].count(True) == 1
    choice = step.choice
    assert choice.law_max_error is not None
    assert choice.law_max_error <= step.predicted_error + step.law_oracle_error
    assert step.predicted_error <= step.limit


def bettered(points: Sequence[tuple[float, float]], index: int) -> bool:
    t, e = points[index]
    return any(
        (u <= t and f <= e and (u, f) != (t, e)) for u, f in points
    )  # fmt: skip


def test_the_fronts_hold_what_nothing_betters(step: StepTradeoff) -> None:
    law = [w for w in step.ways if w.law_max_error is not None]
    points = [(w.time_ms, w.law_max_error or 0.0) for w in law]
    for index, way in enumerate(law):
        assert way.on_law_front != bettered(points, index)
    everything = [(w.time_ms, w.max_error) for w in step.ways]
    for index, way in enumerate(step.ways):
        assert way.on_front != bettered(everything, index)
    assert not any(way.on_law_front for way in step.ways if way.rays_per_cell)


@given(
    st.lists(
        st.tuples(st.integers(0, 9), st.one_of(st.none(), st.integers(0, 9))),
        max_size=12,
    )
)
def test_a_front_betters_all_others(points: list[tuple[int, int | None]]) -> None:
    found = front([(float(t), e if e is None else float(e)) for t, e in points])
    known = {i: (t, e) for i, (t, e) in enumerate(points) if e is not None}
    assert bool(found) == bool(known)
    for i in found:
        assert not any(
            t <= known[i][0] and e <= known[i][1] and (t, e) != known[i]
            for t, e in known.values()
        )
    for t, e in known.values():
        assert any(known[i][0] <= t and known[i][1] <= e for i in found)


@pytest.mark.slow
def test_the_same_look_gives_the_same_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ways, "BANDS", (5e-4,))  # a few of all are enough
    monkeypatch.setattr(ways, "RAYS", (16,))
    sight = sight_of(two_discs(), 0.0, -6.0)
    found = [numbers(sight), numbers(sight)]
    assert found[0] == found[1]


def numbers(sight: ReferenceView) -> list[MeasuredMethod]:
    """Return what is measured, without what depends on the time it took."""
    fidelity = choose(
        sight.scene, SMALL, focus_um=sight.focus_um, limit=0.002, window=FRAME
    )
    law = exact_reference(sight, 40.0)
    layered = traced_reference(sight, law, fidelity.sampling.margin)
    return [
        replace(way, time_ms=0.0, on_law_front=False, on_front=False)
        for way in measure(sight, fidelity, "blend", law, layered)
    ]


def test_both_oracles_of_the_law_agree_within_their_errors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sight = sight_of(one_layer(rectangle(-12.0, -8.0, 9.0, 11.0)), 0.0, -8.0, 25.0)
    closed = exact_reference(sight, 40.0)
    monkeypatch.setattr(truths, "_SLOWEST", 0.0)
    banded = exact_reference(sight, 40.0)
    assert closed.name != banded.name
    assert closed.images.shape == banded.images.shape == (3, 20, 24)
    away = float(np.abs(closed.images - banded.images).max())
    assert 0 < away <= closed.error + banded.error


@pytest.mark.slow
def test_hidden_layers_are_those_of_the_slow_oracle() -> None:
    sight = sight_of(two_discs(), 0.0)
    law = exact_reference(sight, 40.0)
    layered = traced_reference(sight, law, 40.0)
    slow = oracle_image(two_discs(), SMALL, focus_um=0.0, window=FRAME)
    away = float(np.abs(layered.images[0] - slow).max())
    blended = float(np.abs(law.images[0] - slow).max())
    # the oracle's own rays and cells: `microplan.optics.oracle.oracle_image`
    assert away <= layered.error + 4e-4 + 1e-3
    assert blended > 5 * away


def test_one_height_hides_nothing() -> None:
    sight = sight_of(one_layer(disc(12.0)), 0.0, 5.0)
    law = exact_reference(sight, 40.0)
    layered = traced_reference(sight, law, 40.0)
    assert np.array_equal(layered.images[0], law.images[0])
    assert layered.error == law.error
    fidelity = choose(sight.scene, SMALL, focus_um=(0.0,), limit=0.01, window=FRAME)
    assert not any(way.rays for way in ways.render_methods(sight, fidelity))


def test_the_law_is_measured_where_the_choice_must_hold() -> None:
    assert FOCUS_SIGMAS == cases._FOCUS_SIGMAS


def test_the_pictures_have_content(folder: Path) -> None:
    plot = decoded((folder / "tradeoff-see_post.png").read_bytes())
    assert plot.shape[0] > 400
    assert plot.shape[1] > 700
    # a colour for every law, the choice's and the limit's besides
    assert len(np.unique(plot.reshape(-1, 3), axis=0)) > 100
    strip = decoded((folder / "strip-see_post.png").read_bytes())
    assert strip.shape[1] > 1200
    assert strip.std() > 20


def strip_of_post(task_file: Path) -> Strip:
    task, report = read(task_file), Report()
    (request,) = requests(task, unfold(task, report), 0, None)
    low, _ = task.workcell.optics.magnification
    view = views(task, request, low, report)[0]
    return strip_of(task, request, view, "a post")


def test_a_strip_is_sharpest_in_focus_with_the_target_in_the_middle(
    task_file: Path,
) -> None:
    strip = strip_of_post(task_file)
    assert len(strip.focus_um) == 5
    assert strip.focus_um[2] == strip.nominal_um == 250.0
    assert strip.magnifications == pytest.approx((6.9, np.sqrt(6.9 * 44.5), 44.5))
    for line in strip.images:
        steepest = [float(np.abs(np.diff(image, axis=1)).max()) for image in line]
        assert np.argmax(steepest) == 2
        rows, columns = line[2].shape
        assert line[2][rows // 2, columns // 2] > 3 * line[2][2, 2]
    sides = [np.count_nonzero(line[2] > 0.3) ** 0.5 for line in strip.images]
    # the post's width grows with the zoom; its edge is a pixel wide
    assert sides[1] / sides[0] == pytest.approx(np.sqrt(44.5 / 6.9), rel=0.05)
    assert strip_png(strip) == strip_png(strip)


def test_scale_bars_are_round() -> None:
    found = [round_down(v) for v in (0.99, 1.0, 4.9, 5.0, 73.0, 209.0, 1e-4)]
    assert found == [0.5, 1.0, 2.0, 5.0, 50.0, 200.0, 1e-4]


def test_the_front_and_the_choice_are_printed(said: str, step: StepTradeoff) -> None:
    assert said.startswith("see_post: shaft_plate.post at 6.9 x, focus 250 um")
    assert f"limit {LIMIT}" in said
    assert said.count("\n  >  ") == 1
    assert "the compiler's choice: law and sampling predicted" in said
    front = [way for way in step.ways if way.on_law_front or way.on_front]
    assert all(f"{way.max_error:.1e}" in said for way in front)


def test_a_tighter_limit_than_the_tasks_changes_the_choice(
    task_file: Path, step: StepTradeoff
) -> None:
    task, report = read(task_file), Report()
    (request,) = requests(task, unfold(task, report), 0, None)
    view = views(task, request, task.workcell.optics.magnification[0], report)[0]
    usual = task.optimise.image_error()
    _, fidelity = cases.build_case(task, request, view, usual)
    assert step.limit == LIMIT < fidelity.predicted_error <= usual
    assert step.choice.model != fidelity.model


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--step", "find_wheel"), "no step 'find_wheel'; known: find_gear, see_f"),
        (("--step", "grasp"), "step 'grasp' has no look to measure"),
    ],
)
def test_a_step_that_cannot_be_measured_is_said(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    said: str,
) -> None:
    out = tmp_path / "found"
    assert main(["tradeoff", TASK, *words, "-o", str(out)]) == 2
    err = capsys.readouterr().err
    assert "error[MP404]: " in err
    assert said in err
    assert not out.exists()


def test_a_folder_that_cannot_be_written_is_said_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way")
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        assert main(["tradeoff", TASK, "-o", str(out)]) == 2
    captured = capsys.readouterr()
    assert captured.err.count("error[MP702]") == 2
    assert captured.out == ""


def test_compiler_and_preview_load_no_matplotlib() -> None:
    script = (
        "import sys, microplan.planner.cli.main, microplan.planner.plan.compiler\n"
        "import microplan.planner.tradeoff.preview, microplan.executor.cli.main\n"
        "sys.exit('matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", script], check=False)
    assert done.returncode == 0


def test_a_look_without_contrast_has_a_picture_too() -> None:
    """Faces as bright as what is behind them: no way errs, nor does the oracle."""
    way = MeasuredMethod(
        model="exact",
        layers="blend",
        band_error=5e-4,
        margin=10.0,
        float_bits=64,
        rays_per_cell=0,
        time_ms=1.0,
        law_max_error=0.0,
        law_rms_error=0.0,
        max_error=0.0,
        rms_error=0.0,
        is_choice=True,
        on_law_front=True,
        on_front=True,
    )
    blank = StepTradeoff(
        step="look",
        look="look",
        target="plate",
        magnification=6.9,
        focus_um=0.0,
        focus_heights_um=(0.0,),
        row=0,
        column=0,
        rows=10,
        columns=10,
        um_per_px=1.0,
        layers_in_view=("plate",),
        limit=0.002,
        predicted_error=0.0,
        predicted_layer_error=0.0,
        law_oracle="closed form",
        law_oracle_error=0.0,
        oracle="closed form",
        oracle_error=0.0,
        floor_ms=0.1,
        ways=(way, replace(way, time_ms=2.0, is_choice=False)),
    )
    assert tradeoff_png(blank).startswith(b"\x89PNG")  # a warning is an error here
