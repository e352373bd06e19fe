"""Micro-Manager's real core with its demo devices, as drivers."""

from __future__ import annotations

import importlib.util
import math
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.testing import Bench, conforms, failures

HERE = importlib.util.find_spec("pymmcore_plus") is not None
if HERE:
    from microplan.executor.micromanager.hub import Hub, hub
    from tests.executor.micromanager.micromanager_bench import DEVICES, demo, options
pytestmark = pytest.mark.skipif(not HERE, reason="needs microplan[micromanager]")
ROOT = Path(__file__).parents[3]
BEYOND = {
    "x_um": 501.0, "y_um": -501.0, "z_um": 251.0, "theta_rad": 3.2,
    "opening_um": 201.0, "magnification": 51.0, "focus_um": 501.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def found() -> Iterator[Hub]:
    with demo() as made:
        yield made


def bench(found: Hub) -> Bench:
    return Bench(clock=found.clock, beyond=BEYOND)


@pytest.mark.parametrize("role", ["stage", "jaws", "lens", "light", "camera", "clock"])
def test_the_drivers_do_what_they_must(role: str, found: Hub) -> None:
    conforms(getattr(found, role), role, bench(found))


@pytest.mark.parametrize(
    ("role", "old", "new"),
    [
        ("jaws", "speed = 200\npaced = true", "speed = 200"),
        (
            "lens",
            'zoom = { device = "Zoom", limits = [-10, 50], speed = 20, paced = true }',
            'zoom = { device = "Turret", states = [[5, 0], [6, 1]] }',
        ),
    ],
)
def test_what_jumps_cannot_be_seen_moving_or_be_stopped(
    role: str, old: str, new: str
) -> None:
    assert old in DEVICES
    with demo(DEVICES.replace(old, new)) as found:
        wrong = {r.check for r in failures(getattr(found, role), role, bench(found))}
    assert wrong == {
        "returns before it has arrived", "stops twice as once",
        "stops from another thread",
    }  # fmt: skip


def test_limits_are_the_drivers_because_the_core_has_none(found: Hub) -> None:
    assert found.stage is not None
    found.core.setXYPosition("XY", math.nan, 0.0)  # a real stage would do something
    time.sleep(0.05)
    found.core.stop("XY")
    found.core.setXYPosition("XY", 0.0, 0.0)
    found.core.waitForDevice("XY")
    for target in (math.nan, 501.0):
        with pytest.raises(ValueError, match=r"outside -500\.\.500"):
            found.stage.start(x_um=target, z_um=1.0)
    assert not found.stage.moving()
    assert found.stage.reading().z_um == 0.0


def test_a_wait_that_is_over_leaves_the_axis_moving_and_a_stop_does_not() -> None:
    """Why the driver never waits: the core's own wait gives up and stops nothing."""
    with demo() as found:
        assert found.stage is not None
        assert found.core.getTimeoutMs() == 5000
        found.core.setTimeoutMs(50)
        found.stage.start(x_um=400.0)  # takes .4 s
        with pytest.raises(RuntimeError, match="timed out"):
            found.core.waitForDevice("XY")
        assert found.stage.moving()
        found.stage.stop()
        assert not found.stage.moving()
        assert found.stage.reading().x_um < 400.0


def test_an_order_of_one_axis_keeps_the_other_where_it_was_sent(found: Hub) -> None:
    """The demo stage rounds to .015 um, downwards when it is read."""
    assert found.stage is not None
    found.stage.start(x_um=0.1, y_um=-0.1)
    _rest(found)
    first = found.stage.reading()
    for x_um in (0.2, 0.3, 0.4, 0.5, 0.1):
        found.stage.start(x_um=x_um)
        _rest(found)
    assert found.stage.reading() == first
    assert abs(first.y_um + 0.1) <= 0.015


def test_a_slow_order_sets_the_speed(found: Hub) -> None:
    assert found.stage is not None
    found.stage.start(x_um=0.0, y_um=0.0, z_um=0.0)
    _rest(found)
    began_s = time.monotonic()
    found.stage.start(x_um=20.0, z_um=20.0, speed_um_per_s=100.0)
    _rest(found)
    took_s = time.monotonic() - began_s
    found.stage.start(x_um=0.0, z_um=0.0)
    _rest(found)
    assert took_s >= 0.2 - 1e-3  # the demo stage counts whole ms
    assert found.core.getProperty("XY", "Velocity") == "1.0000"


def test_an_axis_that_cannot_be_slowed_down_refuses() -> None:
    text = DEVICES.replace("speed = 400, paced = true", "speed = 400")
    with demo(text) as found:
        assert found.stage is not None
        with pytest.raises(ValueError, match="cannot be slowed down"):
            found.stage.start(z_um=20.0, speed_um_per_s=100.0)
        assert found.stage.reading().z_um == 0.0
        found.stage.start(z_um=20.0, speed_um_per_s=400.0)
        assert found.stage.reading().z_um == 20.0


def test_a_motion_that_nobody_watches_stands() -> None:
    with demo() as found:
        assert found.stage is not None
        found.stage.start(z_um=200.0)  # takes .5 s
        time.sleep(0.3)
        assert found.core.getPosition("Z") == 0.0
        found.stage.reading()
        assert found.core.getPosition("Z") * 1.0 <= 0.1 * 400 + 1e-9  # LONGEST_S of it


def _rest(found: Hub) -> None:
    assert found.stage is not None
    while found.stage.moving():
        time.sleep(0.005)


def test_the_light_follows_and_a_property_keeps_its_own_limits(found: Hub) -> None:
    assert found.light is not None
    found.light.set_level(0.5)
    assert float(found.core.getProperty("Lamp", "Voltage")) == 2.5
    assert found.core.getShutterOpen("Shutter")
    found.light.set_level(0.0)
    assert not found.core.getShutterOpen("Shutter")
    with pytest.raises(ValueError, match=r"Voltage = 15 is outside 0\.\.10"):
        found.light.set_level(3.0)


def test_a_stop_waits_for_a_call_of_the_same_adapter_and_for_no_other() -> None:
    """Micro-Manager has one lock per adapter library, not one per core."""
    other = 'Z2 = { adapter = "SequenceTester", device = "TZStage" }\n[stage]'
    hub_row = 'Hub2 = { adapter = "SequenceTester", device = "THub" }\n'
    text = DEVICES.replace("[stage]", hub_row + other)
    with demo(text.replace("exposure_ms = 5", "exposure_ms = 700")) as found:
        ended: dict[str, float] = {}

        def call(name: str, made: object) -> threading.Thread:
            def work() -> None:
                made()  # type: ignore[operator]  # a call
                ended[name] = time.monotonic()

            thread = threading.Thread(target=work)
            thread.start()
            return thread

        snap = call("snap", found.core.snapImage)
        # this line runs while it exposes: no lock is held on Python
        time.sleep(0.2)
        others = [
            call("other", lambda: found.core.stop("Z2")),
            call("same", lambda: found.core.stop("XY")),
        ]
        for thread in (snap, *others):
            thread.join(10.0)
    assert ended["other"] < ended["snap"]
    assert ended["same"] >= ended["snap"] - 0.05


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('[jaws]\ndevice = "Jaws"', "[jaws]", "jaws.device: it is missing"),
        ("limits = [-100, 200]", "", "jaws.limits: it is missing"),
        ("limits = [-100, 200]", "limits = [2, 1]", "the first must be less"),
        ("full = 5", "full = 0", "light.full: found 0"),
        ("per = 2", "per = 0", "lens.focus.per: found 0"),
        ("exposure_ms = 5", "exposure_s = 5", "camera.exposure_s: no such key"),
        ("paced = true\n[lens]", "paced = 1\n[lens]", "jaws.paced: found 1"),
        ("[light]", "[lihgt]", "lihgt: no such key"),
    ],
)
def test_a_mistake_in_the_table_is_told_with_its_key(
    old: str, new: str, why: str
) -> None:
    assert old in DEVICES
    with pytest.raises(ExecutorError) as told:
        hub(**options(DEVICES.replace(old, new)))
    assert told.value.code == "MP812"
    assert why in told.value.message


def test_states_are_pairs_each_once() -> None:
    good = 'zoom = { device = "Turret", states = [[5, 0], [6, 1]] }'
    for bad in ("[]", "[5]", "[[5, 0], [5, 1]]", "[[5, 0], [6, 0]]", "[[5, 0.5]]"):
        text = DEVICES.replace(
            'zoom = { device = "Zoom", limits = [-10, 50], speed = 20, paced = true }',
            good.replace("[[5, 0], [6, 1]]", bad),
        )
        with pytest.raises(ExecutorError) as told:
            hub(**options(text))
        assert told.value.code == "MP812"


def test_a_device_that_does_not_load_leaves_nothing_loaded() -> None:
    with pytest.raises(RuntimeError, match="DXYStag"):
        hub(**options(DEVICES.replace('"DXYStage"', '"DXYStag"')))


CONFIGURED = """
adapters = "test"
config = "{folder}/MMConfig_demo.cfg"
[stage]
xy = {{ device = "XY", limits_x_um = [-9, 9], limits_y_um = [-9, 9], speed = 1e4 }}
z = {{ device = "Z", limits = [-9, 9], speed = 100, paced = true }}
[lens]
zoom = {{ device = "Objective", states = [[10, 1], [20, 3], [40, 0]] }}
focus = {{ device = "Autofocus", property = "Dichroic", limits = [0, 1], speed = 1 }}
[camera]
device = "Camera"
"""


def test_a_configuration_of_micro_manager_is_loaded() -> None:
    from mm_test_adapters import device_adapter_path

    text = CONFIGURED.format(folder=device_adapter_path())
    with pytest.raises(ValueError, match="no property 'Dichroic', only"):
        hub(**options(text))
    lens, camera = text.index("[lens]"), text.index("[camera]")
    with demo(text[:lens] + text[camera:]) as found:
        assert found.lens is None
        assert found.stage is not None
        assert found.stage.reading().x_um == 0.0
        assert found.stage.serial == "stage XY+Z"
    focus = 'focus = { device = "Z", limits = [-9, 9], speed = 10 }\n'
    zoom = text[lens : text.index("focus =")]
    with demo(text[: text.index("[stage]")] + zoom + focus) as found:
        assert found.lens is not None
        found.lens.start_magnification(20.0)
        found.lens.start_focus_um(5.0)
        assert found.lens.reading() == (20.0, 5.0)
        assert found.core.getState("Objective") == 3
        with pytest.raises(ValueError, match="Objective has no 21, only 10, 20, 40"):
            found.lens.start_magnification(21.0)
        found.core.setState("Objective", 2)
        with pytest.raises(RuntimeError, match="state 2, which has no value"):
            found.lens.reading()


ENDS = {
    "moving": "found.stage.start(x_um=499.0, z_um=200.0)",
    "called": """
import contextlib, threading
begun = threading.Event()
def snap():
    begun.set()
    with contextlib.suppress(RuntimeError):  # Python may have ended before the call
        found.core.snapImage()
threading.Thread(target=snap, daemon=True).start()
begun.wait()
found.stage.start(x_um=499.0, speed_um_per_s=10.0)
""",
    "closed": "found.stage.start(x_um=499.0)\nfound.close()\nfound.close()",
    "left": "found.stage.start(x_um=499.0)\nimport sys\nsys.exit(0)",
}


@pytest.mark.parametrize("how", ENDS)
def test_python_ends_well_while_devices_move(how: str) -> None:
    """Without closing, it aborts here: a moving stage calls into an ended Python."""
    program = (
        "from tests.executor.micromanager.micromanager_bench import options\n"
        "from microplan.executor.micromanager.hub import hub\n"
        f"found = hub(**options())\n{ENDS[how]}\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True, text=True, cwd=ROOT, timeout=60, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
