"""Small hubs of Micro-Manager's demo devices."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from microplan.executor.micromanager.hub import Hub, hub

EXAMPLE = Path(__file__).parents[3] / "examples" / "stations" / "micromanager_demo.toml"
# The steps of the bench take 40 to 150 ms at these speeds: enough to be seen moving.
DEVICES = """
adapters = "test"
[load]
XY = { adapter = "DemoCamera", device = "DXYStage" }
Z = { adapter = "DemoCamera", device = "DStage" }
Turn = { adapter = "DemoCamera", device = "DStage" }
Jaws = { adapter = "DemoCamera", device = "DStage" }
Zoom = { adapter = "DemoCamera", device = "DStage" }
Turret = { adapter = "DemoCamera", device = "DObjective" }
Focus = { adapter = "DemoCamera", device = "DStage" }
Lamp = { adapter = "DemoCamera", device = "D-DA" }
Shutter = { adapter = "DemoCamera", device = "DShutter" }
Camera = { adapter = "DemoCamera", device = "DCam" }
[stage]
xy = { device = "XY", limits_x_um = [-500, 500], limits_y_um = [-500, 500], speed = 1000, speed_property = "Velocity", speed_per = 0.001 }
z = { device = "Z", limits = [-250, 250], speed = 400, paced = true }
theta = { device = "Turn", limits = [-180, 180], speed = 10, paced = true }
[jaws]
device = "Jaws"
limits = [-100, 200]
speed = 200
paced = true
[lens]
zoom = { device = "Zoom", limits = [-10, 50], speed = 20, paced = true }
focus = { device = "Focus", limits = [-500, 500], per = 2, speed = 200, paced = true }
[light]
device = "Lamp"
property = "Voltage"
full = 5
shutter = "Shutter"
[camera]
device = "Camera"
exposure_ms = 5
"""  # noqa: E501 - TOML


def options(text: str = DEVICES) -> dict[str, Any]:
    """Return a hub's table."""
    return tomllib.loads(text)


@contextmanager
def demo(text: str = DEVICES) -> Iterator[Hub]:
    """Yield a hub, and close it."""
    found = hub(**options(text))
    try:
        yield found
    finally:
        found.close()
