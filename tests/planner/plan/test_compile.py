"""From a task to a plan folder: what it holds, and what it depends on."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import jsonschema
import numpy as np
import pytest

from microplan.executor.devices.station import preflight
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.simulated.cell import build_cell
from microplan.planner.cli.main import main
from microplan.planner.diff.compare import compare_plans
from microplan.planner.plan.compiler import compile_task
from microplan.planner.plan.emit import PlanFiles
from microplan.planner.plan.options import Options
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.memo import Memo
from microplan.planner.store.pictures import picture_sha256
from microplan.planner.store.store import Store, place
from microplan.schemas.codec import from_data
from microplan.schemas.files import json_schema
from microplan.schemas.files.world import World
from microplan.schemas.plan import Plan, dump_plan, parse_plan
from tests.golden.__main__ import FEW_TRIALS, GOLDEN, compile_fast
from tests.planner import few_trials
from tests.planner.examples import (
    FEW,
    GRASP,
    ONE_LOOK,
    POST_UM,
    ROOT,
    between_jaws,
    change,
    copy_example,
    cut,
    microplan,
    one_look,
    read,
)

RELEASE = "{id: release, do: release, target: gear, opening_um: 130}"
FIND_GEAR = "{id: find_gear, do: locate, target: gear, view_um: [0, 0]}"


def compiled(file: Path) -> PlanFiles:
    """Return what a task compiles to with fewer trials than any preset has."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("microplan.planner.plan.compiler.PRESETS", {"fast": FEW})
        kept = Memo(Store(place()))  # what a change leaves is not computed again
        files = compile_task(read(file), Report(), Options(preset="fast", memo=kept))
    assert files is not None
    return files


def meaning(plan: Plan) -> dict[str, Any]:
    """Return a plan without its provenance and the keys that hash it."""
    data: dict[str, Any] = json.loads(dump_plan(plan))
    del data["provenance"]
    return data


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Return the example's task cut down to one look."""
    file = copy_example(tmp_path / "task")
    one_look(file)
    return file


@pytest.fixture(scope="module")
def small_plan(tmp_path_factory: pytest.TempPathFactory) -> PlanFiles:
    """Return the one-look task, compiled."""
    file = copy_example(tmp_path_factory.mktemp("small") / "task")
    one_look(file)
    return compiled(file)


def test_the_plan_fits_its_schema_and_its_types(compiled_example: Path) -> None:
    text = (compiled_example / "plan.json").read_text(encoding="utf-8")
    jsonschema.Draft202012Validator(json_schema.load("plan")).validate(json.loads(text))
    plan = parse_plan(text)
    assert dump_plan(plan) == text
    assert plan.status == "feasible"
    assert [step.id for step in plan.steps] == [
        "find_gear", "see_fingers", "bring_between", "grasp", "lift",
        "gear_in_fingers", "aside", "find_shaft", "over_shaft", "insert", "release",
        "retract", "check_seated",
    ]  # fmt: skip


def differences(golden: Path, folder: Path) -> list[str]:
    """Return in what a plan just compiled differs from a golden one."""
    kept, found = (
        parse_plan(file.read_text(encoding="utf-8"))
        for file in (golden, folder / "plan.json")
    )
    return [f"{change.where}: {change.says}" for change in compare_plans(kept, found)]


def test_the_plan_agrees_with_the_golden_one(compiled_example: Path) -> None:
    told = differences(FEW_TRIALS, compiled_example)
    assert told == [], "meant? python -m tests.golden"


@pytest.mark.slow
def test_the_plan_at_fast_agrees_with_the_golden_one(tmp_path: Path) -> None:
    """With all its trials and charges; the plan of few trials takes the same road."""
    done = compile_fast(tmp_path / "fast.plan")
    assert done.returncode == 0, done.stderr
    told = differences(GOLDEN, tmp_path / "fast.plan")
    assert told == [], "meant? python -m tests.golden"


def test_pictures_and_arrays_are_there_and_hashes_are_of_pixels(
    compiled_example: Path,
) -> None:
    plan = parse_plan((compiled_example / "plan.json").read_text(encoding="utf-8"))
    looks = [look for step in plan.steps for look in step.looks]
    assert len(looks) == 8
    for look in looks:
        raw = np.frombuffer((compiled_example / look.scene.image).read_bytes(), "u1")
        pixels = cv2.imdecode(raw, cv2.IMREAD_UNCHANGED)
        assert pixels is not None
        assert pixels.shape == (480, 640)
        assert picture_sha256(pixels.astype(np.uint8)) == look.scene.image_sha256
        assert int(np.ptp(pixels)) > 50  # something is to be seen
    named = {
        use.arrays
        for look in looks
        for use in look.measure.chain + look.measure.fallback
        if use.arrays is not None
    }
    stored = {f"artifacts/{p.name}" for p in (compiled_example / "artifacts").iterdir()}
    assert named == stored
    assert named
    for name in sorted(named):
        with np.load(compiled_example / name, allow_pickle=False) as arrays:
            assert all(np.isfinite(arrays[key]).all() for key in arrays)


def test_journal_keys_chain(compiled_example: Path) -> None:
    plan = json.loads((compiled_example / "plan.json").read_text(encoding="utf-8"))
    before = ""
    for step in plan["steps"]:
        content = json.dumps({**step, "key": ""}, sort_keys=True)
        before = hashlib.sha256(f"{before}\n{content}".encode()).hexdigest()
        assert step["key"] == before


def test_nothing_names_the_machine_or_the_time(compiled_example: Path) -> None:
    for name in ("plan.json", "world.json"):
        text = (compiled_example / name).read_text(encoding="utf-8")
        assert str(ROOT) not in text
        assert str(compiled_example) not in text
        assert f'": "{time.gmtime().tm_year}-' not in text
        assert "NaN" not in text
        assert text.endswith("}\n")


def test_bytes_depend_on_neither_jobs_nor_hash_seed(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    one_look(file)
    folders = []
    # the second must not be given what the first has kept
    for jobs, seed, kept in (("1", "0", ()), ("2", "4711", ("--no-cache",))):
        folders.append(tmp_path / f"{jobs}.plan")
        words = ("-o", str(folders[-1]), "--preset", "fast", "--jobs", jobs, *kept)
        call = ("compile", str(file), *words)
        done = microplan(*call, hash_seed=seed, module=few_trials.__name__)
        assert done.returncode == 0, done.stderr
    one, two = ({p.relative_to(f): p for p in f.rglob("*.*")} for f in folders)
    assert one.keys() == two.keys()
    plain = [name for name in one if name.parts[0] != "evidence"]
    assert len(plain) == 8  # six of JSON, an image, and the arrays of one routine
    assert len(one) - len(plain) == 6  # a look's trials, and five of their images
    for name, path in one.items():
        if name.name != "timings.json":
            assert path.read_bytes() == two[name].read_bytes(), name


def test_the_order_of_keys_means_nothing(small: Path, small_plan: PlanFiles) -> None:
    text = small.read_text(encoding="utf-8")
    blocks = text.split("\n\n")
    head = [b for b in blocks if "microplan: 1" in b]
    rest = [b for b in blocks if "microplan: 1" not in b]
    small.write_text("\n\n".join([*head, *reversed(rest)]) + "\n", encoding="utf-8")
    change(small, ONE_LOOK, "{view_um: [0, 0], target: shaft_plate.post, do: locate, "
           "id: see_post}")  # fmt: skip
    assert small.read_text(encoding="utf-8") != text
    assert dump_plan(compiled(small).plan) == dump_plan(small_plan.plan)


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        pytest.param(
            "parts/shaft_plate.dxf",
            f"{POST_UM}",
            f"{POST_UM - 0.5}",
            id="post diameter",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "workcell.yaml",
            "numerical_aperture: 0.42",
            "numerical_aperture: 0.40",
            id="aperture",
        ),
        pytest.param(
            "task.yaml", "seed: 1998", "seed: 1999", id="seed", marks=pytest.mark.slow
        ),
    ],
)
def test_what_matters_changes_the_plan(
    small: Path, small_plan: PlanFiles, file: str, old: str, new: str
) -> None:
    change(small.parent / file, old, new)
    plan = compiled(small).plan
    assert plan.provenance != small_plan.plan.provenance
    assert (
        meaning(plan)["steps"][0]["looks"]
        != meaning(small_plan.plan)["steps"][0]["looks"]
    )


def move_tooth(file: Path) -> None:
    """Turn the fourth tooth of the gear by a quarter of a degree."""
    script = file.parent / "make_parts.py"
    change(script, "    for k in range(TEETH):\n", "    for k in range(TEETH):\n"
           "        off, after = 0.25 * (k == 3), 0.25 * (k == 2)\n")  # fmt: skip
    for sign in "-+":
        change(script, f"pitch * k {sign} TIP", f"pitch * k + off {sign} TIP")
    change(script, "tip[0] + pitch)", "tip[0] - off + pitch + after)")
    done = subprocess.run(
        [sys.executable, str(script), str(file.parent / "parts")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_moved_tooth_changes_the_plan(tmp_path: Path) -> None:
    plans = []
    for name, edit in (("as_drawn", None), ("moved", move_tooth)):
        file = copy_example(tmp_path / name)
        cut(file, FIND_GEAR)
        change(file, "sigma_xy_um: 30", "sigma_xy_um: 2")
        if edit is not None:
            edit(file)
        plans.append(compiled(file).plan)
    old, new = plans
    hashes = [plan.provenance.drawings_sha256 for plan in plans]
    assert hashes[0]["gear"] != hashes[1]["gear"]
    assert hashes[0]["shaft_plate"] == hashes[1]["shaft_plate"]
    sights = [plan.steps[0].looks[0].scene.image_sha256 for plan in (old, new)]
    assert sights[0] != sights[1]


Edit = Callable[[Path], None]


def only_zoom(file: Path) -> None:
    """Allow one magnification only, at which the gear does not fit."""
    cut(file, FIND_GEAR)
    change(file.with_name("workcell.yaml"), "min: 6.9", "min: 44.5")


def sticky(file: Path) -> None:
    """Let one part in ten stick to a finger."""
    between_jaws(file)
    cut(file, GRASP, RELEASE)
    change(
        file.with_name("workcell.yaml"),
        "length_um: 20800", "length_um: 20800\n    stick_probability: 0.1",
    )  # fmt: skip


def thick(file: Path) -> None:
    """Make the post thicker than the bore."""
    between_jaws(file)
    change(file.with_name("parts") / "shaft_plate.dxf", "22.0", "26.0")
    cut(file, GRASP, "{id: insert, do: insert, target: gear.bore, onto: "
        "shaft_plate.post, move: [{stage: {z_um: 1}}]}")  # fmt: skip


INFEASIBLE: Mapping[str, tuple[Edit, str, int]] = {
    "larger than the field": (only_zoom, "MP401", 0),
    "likely to fail": (sticky, "MP602", 2),
    "thicker than the bore": (thick, "MP601", 2),
}


@pytest.mark.parametrize("case", sorted(INFEASIBLE))
def test_what_cannot_be_done_is_written_and_ends_with_one(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edit, code, steps = INFEASIBLE[case]
    file = copy_example(tmp_path / "task")
    edit(file)
    assert main(["compile", str(file), "--preset", "fast"]) == 1
    captured = capsys.readouterr()
    assert f"infeasible[{code}]" in captured.err
    assert "gear-on-shaft: infeasible" in captured.out
    text = (file.parent / "gear-on-shaft.plan" / "plan.json").read_text("utf-8")
    jsonschema.Draft202012Validator(json_schema.load("plan")).validate(json.loads(text))
    plan = parse_plan(text)
    assert plan.status == "infeasible"
    assert code in {reason.code for reason in plan.reasons}
    assert len(plan.steps) == steps
    assert ("P(success) is not worked out" in captured.out) is (code == "MP401")


def test_a_task_at_fault_writes_nothing_and_ends_with_two(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = copy_example(tmp_path / "task")
    cut(file, RELEASE)
    assert main(["compile", str(file)]) == 2
    assert "error[MP301]" in capsys.readouterr().err
    assert not (file.parent / "gear-on-shaft.plan").exists()


def test_the_executor_needs_no_world_of_the_compilers(
    compiled_example: Path, tmp_path: Path
) -> None:
    """A station that is given from elsewhere runs from the plan and its arrays."""
    world = json.loads((compiled_example / "world.json").read_text(encoding="utf-8"))
    folder = Path(shutil.copytree(compiled_example, tmp_path / "bare.plan"))
    (folder / "world.json").unlink()
    plan = parse_plan((folder / "plan.json").read_text(encoding="utf-8"))
    station = build_cell(from_data(World, world), 0, frozenset()).station
    preflight(plan, station)
    artifacts = Artifacts.from_folder(plan, folder)
    looks = [look for step in plan.steps for look in step.looks]
    for look in looks:
        stages = artifacts.stages(look.id, look.measure.chain)
        assert [name for name, _ in stages] == [use.id for use in look.measure.chain]
