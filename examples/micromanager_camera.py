"""A plan's scene as a camera of pymmcore-plus: the picture follows stage and focus.

    python examples/micromanager_camera.py gear-on-shaft.plan pictures

needs microplan[micromanager] and mm-test-adapters. In napari-micromanager, load this
camera into the core of its main window.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
from mm_test_adapters import device_adapter_path
from pymmcore_plus.experimental.unicore import UniMMCore

from microplan.executor.micromanager.core import close_core
from microplan.executor.micromanager.rendered_camera import Labels, RenderedCamera


def main() -> None:
    """Take a few pictures at places of stage and focus."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plan", type=Path, help="a plan folder")
    parser.add_argument("out", type=Path, help="a folder for the pictures")
    call = parser.parse_args()
    call.out.mkdir(parents=True, exist_ok=True)
    core = UniMMCore()
    try:
        core.setDeviceAdapterSearchPaths([device_adapter_path()])
        for label, device in (("XY", "DXYStage"), ("Z", "DStage"), ("Focus", "DStage")):
            core.loadDevice(label, "DemoCamera", device)
            core.initializeDevice(label)
        labels = Labels(xy="XY", z="Z", focus="Focus")
        core.loadPyDevice("Camera", RenderedCamera.of_plan(call.plan, core, labels))
        core.initializeDevice("Camera")
        core.setCameraDevice("Camera")
        for x_um, focus_um in ((-600.0, 100.0), (-500.0, 100.0), (-500.0, 40.0)):
            core.setXYPosition("XY", x_um, 0.0)
            core.setPosition("Focus", focus_um)
            core.waitForDevice("XY")
            core.snapImage()
            path = call.out / f"x{x_um:g}_focus{focus_um:g}.png"
            cv2.imwrite(str(path), core.getImage())
            print(path)
    finally:
        close_core(core)  # before Python ends, or a moving stage aborts it


if __name__ == "__main__":
    main()
