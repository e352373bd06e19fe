"""Every fault of the simulated cell, in every step where it can strike."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from microplan.executor.devices.errors import CODES
from microplan.executor.devices.station import Station
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.simulated.faults import FAULTS
from microplan.schemas.files.world import World
from microplan.schemas.plan import Plan
from tests.executor.bench import Folder, assembly, quiet, world
from tests.executor.recorder import Run, run
from tests.executor.whole_runs.fault_ends import ENDS

pytestmark = pytest.mark.usefixtures("one_render_a_state")

GOLDEN = Path(__file__).parents[2] / "golden" / "executor"
# steps of the plan in which a device does something
AXES = (
    "find_gear",  # the probe
    "fingers_in", "bring_between", "lift", "find_shaft", "over_shaft", "insert",
    "retract",
)  # fmt: skip
JAWS = ("grasp", "release")
LENS = ("find_gear", "find_shaft", "check_seated")
LOOKS = (
    "find_gear", "bring_between", "gear_in_fingers", "find_shaft", "over_shaft",
    "check_seated",
)  # fmt: skip
STEPS = {"axis": AXES, "jaws": JAWS, "lens": LENS, "camera": LOOKS}
FRAMES = ("dropped_frames", "stale_frames", "short_frames", "light_out")
PAIRS = ({"move", "jaws", "zoom", "focus"}, {"moved", "jaws_moved"})
HANGS = [(n, s) for n in FAULTS if "hang" in n for s in STEPS[n.partition("_")[0]][:2]]
CASES = [
    (name, step)
    for name in FAULTS
    if "hang" not in name
    for step in (LOOKS if name in FRAMES else STEPS.get(name.partition("_")[0], ()))
    if name != "reversed_axis"
]
CASES = [case for case in CASES if case[0] not in ("stick", "block")]
WHOLE = (
    "mirror_camera", "swap_camera", "scale_camera", "reversed_axis", "no_part", "stick",
    "block", "uneven_light",
)  # fmt: skip


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Artifacts, World]:
    """Return the small plan, its artifacts and a world without spreads."""
    maker = Folder(tmp_path_factory.mktemp("matrix") / "gear.plan")
    plan = assembly(maker)
    return plan, Artifacts.from_folder(plan, maker.folder), quiet(world())


def impatient(station: Station) -> Station:
    """Return a station that waits a second for an answer."""
    safety = replace(station.rules.safety, call_s=1.0, grab_s=3.0)
    return replace(station, rules=replace(station.rules, safety=safety))


def check(found: Run, name: str, step: str) -> None:
    """Hold a run with a fault against all that must be so after it."""
    assert found.result.code in ENDS[name].codes, found.result
    assert CODES[str(found.result.code)][1] in (1, 3)
    assert step in ("", found.result.step)
    cell, calls = found.cell, found.recorder.calls
    for device in (cell.stage, cell.robot, cell.jaws, cell.lens):
        assert not device.moving()
    first = next(i for i, c in enumerate(calls) if c.method == "stop")
    stopped = {(c.device, c.method) for c in calls[first:]}
    assert stopped == {(d, "stop") for d in ("stage", "robot", "jaws", "lens")}
    # what runs the wrong way is stopped when it is seen to, a reading later
    assert name == "axis_wrong_way" or not cell.truth.collided
    check_jaws(found)
    check_journal(found)


def check_jaws(found: Run) -> None:
    """The jaws stand where the last order of the plan that was carried out put them."""
    orders = [e["opening_um"] for e in found.events if e["event"] == "jaws"]
    done = sum(e["event"] == "jaws_moved" for e in found.events)
    meant = [130.0, *orders][done]
    assert found.cell.jaws._commanded == meant


def check_journal(found: Run) -> None:
    """The step has begun and is not done; at most one action is open; then the end."""
    events = [e for e in found.events if e["step"] == found.result.step]
    names = [e["event"] for e in events]
    assert names[0] == "begin"
    assert names[-1] == "failed"
    assert "done" not in names
    assert events[-1]["code"] == found.result.code
    assert [e["event"] for e in found.events[-2:]] == ["failed", "end"]
    for began, ended in (("move", "moved"), ("jaws", "jaws_moved")):
        apart = names.count(began) - names.count(ended)
        assert apart in (0, 1)
        if apart:  # what was left open is what failed: nothing began after it
            assert names[-2] == began


def sampled() -> Iterator[object]:
    """Yield all cases, slow but for one of each fault, in another step each time."""
    for name in dict.fromkeys(name for name, _ in CASES):
        steps = [step for each, step in CASES if each == name]
        quick = steps[len(name) % len(steps)]
        for step in steps:
            marks = [] if step == quick else [pytest.mark.slow]
            yield pytest.param(name, step, marks=marks)


@pytest.mark.parametrize(("name", "step"), list(sampled()))
def test_a_fault_in_a_step_ends_in_its_code_and_everything_stands(
    name: str, step: str, job: tuple[Plan, Artifacts, World]
) -> None:
    check(run(*job, [f"{name}@{step}"]), name, step)


@pytest.mark.parametrize(
    ("name", "step", "other"),
    [("stick", "release", "grasp"), ("block", "insert", "over_shaft")],
)
def test_a_fault_of_contact_in_its_step_is_found_afterwards(
    name: str, step: str, other: str, job: tuple[Plan, Artifacts, World]
) -> None:
    found = run(*job, [f"{name}@{step}"])
    check(found, name, "")
    assert found.result.step == "check_seated"
    assert run(*job, [f"{name}@{other}"]).result.done


@pytest.mark.parametrize(("name", "step"), HANGS)
def test_a_device_that_hangs_is_left_and_the_others_are_stopped(
    name: str, step: str, job: tuple[Plan, Artifacts, World]
) -> None:
    check(run(*job, [f"{name}@{step}"], change=impatient), name, step)


@pytest.mark.parametrize("name", WHOLE)
def test_a_fault_from_the_start_on_ends_in_its_code(
    name: str, job: tuple[Plan, Artifacts, World]
) -> None:
    plan, artifacts, still = job
    shifted = tuple(  # a gear beside its nominal place, so that a picture can tell
        replace(p, start=replace(p.start, x_um=p.start.x_um + 6.0, y_um=-4.0))
        if p.name == "gear"
        else p
        for p in still.parts
    )
    found = run(plan, artifacts, replace(still, parts=shifted), [name])
    if ENDS[name].may_stand and found.result.done:
        assert found.cell.judge("gear", "shaft_plate.post").success
        return
    assert found.result.code in (ENDS[name].from_start or ENDS[name].codes)
    check_journal(found)


@pytest.mark.parametrize("name", ["mirror_camera", "swap_camera", "reversed_axis"])
def test_wrong_geometry_is_caught_by_the_probe_before_the_part_is_at_risk(
    name: str, job: tuple[Plan, Artifacts, World]
) -> None:
    found = run(*job, [name])
    assert (found.result.code, found.result.step) == ("MP833", "find_gear")
    moved = {c.device for c in found.recorder.calls if c.method == "start"}
    assert moved == {"stage"}  # the fingers stayed away
    check_journal(found)


def test_every_fault_is_in_the_matrix() -> None:
    covered = {name for name, _ in (*CASES, *HANGS)} | set(WHOLE)
    assert covered == set(FAULTS) == set(ENDS)


@cache
def golden(name: str) -> list[str]:
    return (GOLDEN / f"{name}.txt").read_text(encoding="utf-8").splitlines()


@pytest.mark.parametrize(
    "fault",
    ["", "axis_stalls@insert", "jaws_stuck@release", "stale_frames@over_shaft"],
)
def test_the_calls_of_devices_are_those_of_the_golden_trace(
    fault: str, job: tuple[Plan, Artifacts, World]
) -> None:
    found = run(*job, [fault] if fault else [])
    told = found.recorder.trace()
    wanted = golden(fault.replace("@", "_") or "assembly")
    assert len(told) == len(wanted)
    for line, meant in zip(told, wanted, strict=True):
        for word, other in zip(line.split(), meant.split(), strict=True):
            assert same(word, other), (line, meant)


def same(word: str, other: str) -> bool:
    """Compare words; an alignment's targets depend on measured pixels.

    Those repeat to 1e-6 px across machines; two roundings to .001 um may differ by one.
    """
    name, _, value = word.partition("=")
    other_name, _, other_value = other.partition("=")
    if not value:
        return word == other
    return name == other_name and math.isclose(
        float(value), float(other_value), abs_tol=1.1e-3
    )


def test_the_page_about_the_executor_has_the_table_of_faults() -> None:
    page = (Path(__file__).parents[3] / "docs" / "executor.md").read_text("utf-8")
    for name, fault in ENDS.items():
        ends = ", ".join(fault.codes) + (", or well" if fault.may_stand else "")
        if fault.from_start:
            ends = f"from the start {', '.join(fault.from_start)}; later {ends}"
        assert f"| `{name}` | {FAULTS[name]} | {ends} |" in page
