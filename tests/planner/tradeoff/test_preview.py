"""`microplan render`: the files it writes, and trials as the benchmark had them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.perturb import image
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.render.sampling import BAND_ERROR
from microplan.optics.transfer.models import MODELS
from microplan.planner.assembly.step_states import unfold
from microplan.planner.cli.arguments import LAWS
from microplan.planner.cli.main import main
from microplan.planner.looks.look_problem import Begun, CompileContext, LookProblem
from microplan.planner.looks.look_record import reference_image
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.views.requests import requests
from microplan.planner.views.target_views import views
from microplan.schemas.plan import parse_plan
from tests.planner.examples import EXAMPLE, FEW, change, copy_example, one_look, read

TASK = str(EXAMPLE / "task.yaml")
TRIALS = 24
A = TypeVar("A")
B = TypeVar("B")


def render(out: Path, *words: str, task: str = TASK) -> int:
    return main(["render", task, *words, "-o", str(out)])


def pixels(path: Path) -> npt.NDArray[np.uint8]:
    found = cv2.imdecode(np.frombuffer(path.read_bytes(), "u1"), cv2.IMREAD_UNCHANGED)
    assert found is not None
    return found.astype(np.uint8)


class Recorder:
    """A `map` that keeps what the benchmark hands to its workers."""

    def __init__(self) -> None:
        self.case: LookCase | None = None
        self.trials: list[Trial] = []

    def __call__(
        self, function: Callable[[A], B], items: Iterable[A], /
    ) -> Iterable[B]:
        """Return `function` of each item; keep the case it holds and the trials."""
        chunks: Sequence[A] = list(items)
        for chunk in chunks:
            if isinstance(chunk, tuple) and hasattr(chunk[0], "trial"):
                self.case = function.args[0]  # type: ignore[attr-defined]  # a partial
                self.trials += [each.trial for each in chunk]
        return map(function, chunks)


@pytest.mark.parametrize("limit", [None, pytest.param(0.03, marks=pytest.mark.slow)])
def test_a_trial_is_rebuilt_bit_for_bit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], limit: float | None
) -> None:
    file = copy_example(tmp_path / "task")
    one_look(file)
    task, report, recorder = read(file), Report(), Recorder()
    (look,) = requests(task, unfold(task, report), 0, None)
    effects = CompileContext(
        effort=replace(FEW, trials=TRIALS),
        max_image_error=limit or task.optimise.image_error(),
        map=recorder,
    )
    low, _ = task.workcell.optics.magnification
    problem = LookProblem(task=task, request=look, context=effects, begun=Begun())
    tried = problem.evaluate(views(task, look, low, report)[0])
    assert tried.comparison.selection.chosen is not None
    assert recorder.case is not None
    assert len(recorder.trials) >= TRIALS
    for index in (0, 3, 22):  # the third of each four is an extreme
        out = tmp_path / f"{index}.npy"
        words = ("--step", "see_post", "--trial", str(index))
        budget = ("--max-image-error", str(limit)) if limit else ()
        assert render(out, *words, *budget, task=str(file)) == 0
        benchmark = image(recorder.case, recorder.trials[index])
        assert np.load(out).tobytes() == benchmark.tobytes()
        assert f"trial {index} of see_post at 6.9 x" in capsys.readouterr().out


def test_the_picture_of_a_step_is_the_plansreference_image(
    compiled_example: Path, tmp_path: Path
) -> None:
    plan = parse_plan((compiled_example / "plan.json").read_text(encoding="utf-8"))
    for name in ("find_shaft", "gear_in_fingers"):
        out = tmp_path / f"{name}.png"
        assert render(out, "--step", name) == 0
        look = next(look for s in plan.steps for look in s.looks if look.id == name)
        stored = pixels(compiled_example / look.scene.image)
        # laws differ by less than the task's image error, a picture rounds by half
        away = np.abs(pixels(out).astype(int) - stored.astype(int)).max()
        assert away <= 1 + math.ceil(255 * read(Path(TASK)).optimise.image_error())


def test_the_lens_is_in_the_picture_as_in_the_plans(tmp_path: Path) -> None:
    file, found = copy_example(tmp_path / "task"), []
    one_look(file)
    change(
        file, "view_um: [0, 0]}", "view_um: [250, 150]}"
    )  # nothing moves in the middle
    for distortion in ("0.0", "0.02"):
        change(file.with_name("workcell.yaml"), "distortion: 0.0 ",
               f"distortion: {distortion} ")  # fmt: skip
        task, report = read(file), Report()
        (look,) = requests(task, unfold(task, report), 0, None)
        view = views(task, look, task.workcell.optics.magnification[0], report)[0]
        case, _ = build_case(task, look, view, task.optimise.image_error())
        case = replace(case, model="exact")
        out = tmp_path / "look.png"
        assert render(out, "--step", "see_post", task=str(file)) == 0
        assert np.array_equal(pixels(out), reference_image(task, look, case))
        found.append(pixels(out))
    assert np.abs(found[0].astype(int) - found[1]).max() > 10


def test_a_picture_keeps_the_image_error_that_is_asked_for(tmp_path: Path) -> None:
    found = {}
    for name, words in {
        "exact": (),
        "loose": ("--max-image-error", "0.05"),
        "tight": ("--max-image-error", "0.001"),
        "hopkins": ("--max-image-error", "0.05", "--model", "hopkins"),
    }.items():
        out = tmp_path / f"{name}.npy"
        assert render(out, "--step", "find_gear", "--focus-um", "90", *words) == 0
        found[name] = np.load(out)
    for name, limit in {"loose": 0.05, "hopkins": 0.05, "tight": 0.001}.items():
        away = np.abs(found[name] - found["exact"]).max()
        # `exact` is itself within the error of the usual band
        assert 0 < away <= limit + BAND_ERROR, name
    assert not np.array_equal(found["loose"], found["hopkins"])


def test_help_names_every_defocus_law(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "--help"]) == 0
    assert ", ".join(MODELS) == LAWS
    assert LAWS in " ".join(capsys.readouterr().out.split())


def test_npy_holds_what_png_rounds(tmp_path: Path) -> None:
    png, npy = tmp_path / "a.png", tmp_path / "a.npy"
    assert render(png, "--step", "find_gear") == 0
    assert render(npy, "--step", "find_gear") == 0
    values = np.load(npy)
    assert values.shape == (480, 640)
    assert values.dtype == np.float64
    assert 0 <= values.min() < values.max() <= 1
    assert np.abs(255 * values - pixels(png)).max() <= 0.5 + 1e-9


def test_options_do_what_they_say(tmp_path: Path) -> None:
    found = {}
    for name, words in {
        "plain": (),
        "near": ("--magnification", "20"),
        "blurred": ("--focus-um", "150"),
        "coarse": ("--focus-um", "150", "--model", "product"),
        "noisy": ("--noise",),
    }.items():
        out = tmp_path / f"{name}.npy"
        assert render(out, "--step", "find_gear", *words) == 0
        found[name] = np.load(out)

    def slope(name: str) -> float:
        return float(np.abs(np.diff(found[name], axis=1)).max())

    def bright(name: str) -> float:
        return float((found[name] > found[name].max() / 2).mean())

    assert slope("blurred") < slope("plain") / 4
    assert 0.001 < np.abs(found["coarse"] - found["blurred"]).max() < 0.3
    # the gear's area grows with the square of the magnification
    assert bright("near") / bright("plain") == pytest.approx((20 / 6.9) ** 2, rel=0.05)
    noise = found["noisy"] - found["plain"]
    assert 0.001 < noise.std() < 0.02
    assert np.allclose(found["noisy"] * 255, np.rint(found["noisy"] * 255))


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("--step", "find_wheel"), "MP404", "no step 'find_wheel'; known: find_gear"),
        (("--step", "find_gear", "--model", "zemax"), "MP404", "no defocus law"),
        (("--step", "find_gear", "--magnification", "99"), "MP404", "6.9 to 44.5"),
        (("--step", "find_gear", "--magnification", "nan"), "MP404", "6.9 to 44.5"),
        (("--step", "find_gear", "--focus-um", "inf"), "MP404", "must be finite"),
        (("--step", "grasp", "--trial", "0"), "MP404", "has no look"),
        (("--step", "find_gear", "--trial", "1048576"), "MP404", "0 to 1048575"),
        (("--step", "find_gear", "--trial", "-1"), "MP404", "count from 0"),
        (
            ("--step", "find_gear", "--trial", "0", "--magnification", "7.77"),
            "MP404",
            "is tried at 6.9",
        ),
        (("--step", "find_gear", "--trial", "0", "--model", "product"), "MP404",
         "sets focus and model itself"),
    ],
)  # fmt: skip
def test_what_cannot_be_rendered_is_said(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    code: str,
    said: str,
) -> None:
    assert render(tmp_path / "a.png", *words) == 2
    err = capsys.readouterr().err
    assert f"error[{code}]: " in err
    assert said in err
    assert not (tmp_path / "a.png").exists()


def test_what_cannot_be_written_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert render(tmp_path / "a.gif", "--step", "find_gear") == 2
    (tmp_path / "file").write_text("no folder")
    assert render(tmp_path / "file" / "a.png", "--step", "find_gear") == 2
    assert capsys.readouterr().err.count("error[MP702]") == 2


@pytest.mark.parametrize("suffix", ["png", "npy"])
def test_a_picture_takes_the_place_of_one_of_its_kind_alone(
    tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / f"seen.{suffix}"
    words = ("--step", "find_gear", "--model", "geometric")
    assert render(out, *words) == 0
    first = out.read_bytes()
    assert render(out, *words) == 0
    assert out.read_bytes() == first
    out.write_text("years")
    assert render(out, *words) == 2
    assert "error[MP703]" in capsys.readouterr().err
    assert out.read_text() == "years"
