"""The drivers' calls: how long they take, and how a process with devices ends."""

from __future__ import annotations

import signal
import statistics
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator

from benchmarks.figures import Benchmark, Figure, Options
from microplan.executor.micromanager.hub import hub
from microplan.executor.serial.devices import Controller
from tests.executor.serial.fake_controller import FakeController

COUNT = 300  # calls; the median is told
EXPOSURE_MS = 10.0
NAMES = (
    "drivers.micromanager.reading_ms",
    "drivers.micromanager.start_ms",
    "drivers.micromanager.stop_ms",
    "drivers.micromanager.grab_ms",
    "drivers.micromanager.aborted_unclosed",
    "drivers.micromanager.aborted",
    "drivers.serial.reading_ms",
    "drivers.serial.stop_ms",
)
DEVICES = f"""
adapters = "test"
[load]
XY = {{ adapter = "DemoCamera", device = "DXYStage" }}
Z = {{ adapter = "DemoCamera", device = "DStage" }}
Camera = {{ adapter = "DemoCamera", device = "DCam" }}
[stage.xy]
device = "XY"
limits_x_um = [-500, 500]
limits_y_um = [-500, 500]
speed = 1000
[stage.z]
device = "Z"
limits = [-250, 250]
speed = 1000
[camera]
device = "Camera"
exposure_ms = {EXPOSURE_MS}
"""

PROCESSES = 10
UNCLOSED = """
from mm_test_adapters import device_adapter_path
from pymmcore_plus import CMMCorePlus
core = CMMCorePlus()
core.setDeviceAdapterSearchPaths([device_adapter_path()])
core.loadDevice("XY", "DemoCamera", "DXYStage")
core.initializeDevice("XY")
core.setXYPosition("XY", 1e5, 0.0)
"""
CLOSED = f"""
import tomllib
from microplan.executor.micromanager.hub import hub
found = hub(**tomllib.loads({DEVICES!r}))
found.core.setXYPosition("XY", 1e5, 0.0)
"""


def median_ms(call: Callable[[], object], count: int = COUNT) -> float:
    """Return the median time of a call, ms."""
    took = []
    for _ in range(count):
        began_s = time.perf_counter()
        call()
        took.append(time.perf_counter() - began_s)
    return 1000 * statistics.median(took)


def measure(_options: Options) -> Iterator[Figure]:
    """Yield the figures; floors are the core's own call, and the exposure."""
    yield from _micromanager()
    with FakeController() as fake:
        found = Controller(
            port=fake.path,
            magnification=(1.0, 50.0),
            focus_um=(-500.0, 500.0),
            opening_um=(0.0, 200.0),
        )
        jaws = found.jaws
        yield Figure(name=NAMES[6], value=median_ms(jaws.reading), unit="ms")
        yield Figure(name=NAMES[7], value=median_ms(jaws.stop), unit="ms")
        found.close()


def _micromanager() -> Iterator[Figure]:
    """Yield the figures of Micro-Manager."""
    found = hub(**tomllib.loads(DEVICES))
    stage, camera, core = found.stage, found.camera, found.core
    if stage is None or camera is None:
        raise ValueError("the table names a stage and a camera")
    read_ms = median_ms(lambda: core.getXYPosition("XY"))
    yield Figure(
        name=NAMES[0],
        value=median_ms(lambda: (stage.reading(), stage.moving())),
        unit="ms",
        floor=read_ms,
    )
    set_ms = median_ms(lambda: core.setXYPosition("XY", 0.0, 0.0))
    yield Figure(
        name=NAMES[1],
        value=median_ms(lambda: stage.start(x_um=0.0, y_um=0.0)),
        unit="ms",
        floor=set_ms,
    )
    yield Figure(name=NAMES[2], value=median_ms(stage.stop), unit="ms")
    yield Figure(
        name=NAMES[3],
        value=median_ms(lambda: camera.grab(None, after_s=0.0), 50),
        unit="ms",
        floor=EXPOSURE_MS,
    )
    found.close()
    for name, program in ((NAMES[4], UNCLOSED), (NAMES[5], CLOSED)):
        ended = [_status(program) for _ in range(PROCESSES)]
        aborted = sum(status == -signal.SIGABRT for status in ended)
        yield Figure(name=name, value=aborted / PROCESSES, unit="1")


def _status(program: str) -> int:
    """Return the status of a Python process that ends while a stage moves."""
    command = [sys.executable, "-c", program]
    return subprocess.run(command, capture_output=True, check=False).returncode


BENCHMARK = Benchmark(names=NAMES, measure=measure)
