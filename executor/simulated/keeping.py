"""State of the simulated cell, kept in a file as it changes, to outlive the executor.

Written by the cell after every order that a device took, as a whole or not at all. What
was under way then has ended by itself when the file is read: a real drive goes on too.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.simulated.cell import Cell
from microplan.schemas.codec import from_data, to_data
from microplan.schemas.pose import Pose

FORMAT = 2
_DAY_S = 86400.0  # what axes, jaws and lens do takes seconds
_LATEST_S = 1e9  # thirty years; far below where adding a poll changes nothing
_OF_TRUTH = ("opening_um", "held", "stuck", "pushed_um", "collided")  # kept as it is
_MOST_STEPS = 1_000_000  # a metre of steps of 1 um


def keep(cell: Cell, path: Path) -> None:
    """Have the cell write its world into a file whenever an order changed it."""
    fresh = path.with_suffix(".new")

    def write() -> None:
        with cell.timeline.lock:  # stops come from several threads
            fresh.write_text(json.dumps(state_of(cell)), encoding="utf-8")
            fresh.replace(path)

    write()
    cell.timeline.changed = write


def take(cell: Cell, path: Path) -> None:
    """Put a new cell where the world of a file was left, and let motions end.

    Raises
    ------
    ExecutorError
        MP803 if the file cannot be read; MP866 if it is of another world.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["format"] != FORMAT:
            raise ValueError(f"format {data['format']!r}, need {FORMAT}")
        if data["world"] != _digest(cell):
            raise ExecutorError("MP866", f"{path} is of another world.json")
        _check_left(data)
        restore(cell, data)
        for process in (cell.stage, cell.robot, cell.jaws.motion, cell.lens.motion):
            cell.timeline.run_out(process)
        _check(cell)
    except ExecutorError:
        raise
    except Exception as error:  # a spoilt number may fail anywhere in the simulation
        raise ExecutorError("MP803", f"{path}: {error}") from error


def _check_left(data: dict[str, Any]) -> None:
    """Raise ValueError for times that no cell leaves: no wait may be endless."""
    devices, now_s = data["devices"], data["time_s"]
    left = [devices[name]["left_s"] for name in ("jaws", "lens")]
    for motion in (devices[name]["motion"] for name in ("stage", "robot")):
        if motion is None:
            continue
        left += [motion["seconds"]]
        if not 0 <= motion["taken"] <= motion["count"] <= _MOST_STEPS:
            raise ValueError(f"a motion has not 0 to {_MOST_STEPS} steps")
        if not 0 <= motion["began_s"] <= now_s:
            raise ValueError("a motion began at no time that was")
    if not 0 <= now_s <= _LATEST_S:
        raise ValueError("its time is no time that a cell reaches")
    if not all(0 <= seconds <= _DAY_S for seconds in left if seconds is not None):
        raise ValueError("what was under way would not end within a day")


def state_of(cell: Cell) -> dict[str, Any]:
    """Return all of a cell that changes, as JSON data."""
    truth = cell.truth
    return {
        "format": FORMAT,
        "world": _digest(cell),
        "time_s": truth.time_s,
        "bodies": {
            name: {
                "carrier": body.carrier,
                "pose": asdict(body.pose),
                "z_um": body.z_um,
                "on_posts": dict(body.on_posts),
            }
            for name, body in truth.bodies.items()
        },
        **{name: getattr(truth, name) for name in _OF_TRUTH},
        "devices": {name: device.state() for name, device in _devices(cell).items()},
        "draws": {k: _plain(v.bit_generator.state) for k, v in cell.draws.items()},
    }


def restore(cell: Cell, data: dict[str, Any]) -> None:
    """Put a cell of the same world, seed and faults where another one was."""
    truth = cell.truth
    truth.time_s = data["time_s"]
    for name, body in truth.bodies.items():
        was = data["bodies"][name]
        body.carrier, body.pose = was["carrier"], from_data(Pose, was["pose"])
        body.z_um, body.on_posts = was["z_um"], dict(was["on_posts"])
    for name in _OF_TRUTH:
        setattr(truth, name, data[name])
    for name, device in _devices(cell).items():
        device.restore(data["devices"][name])
    for name, rng in cell.draws.items():
        rng.bit_generator.state = data["draws"][name]


def _check(cell: Cell) -> None:
    """Raise ValueError where a cell holds what no cell could have left."""
    truth = cell.truth
    bodies = truth.bodies.values()
    known = truth.held in ("", *truth.bodies) and isinstance(truth.collided, str)
    if not known or any(body.carrier not in ("stage", "robot") for body in bodies):
        raise ValueError("it tells of what is not in the world")
    for body in bodies:
        if not all(i in range(len(body.holes)) for i in body.on_posts.values()):
            raise ValueError("a post is in no hole of the world")
    numbers = (truth.opening_um, truth.pushed_um, *(body.z_um for body in bodies))
    if not all(math.isfinite(number) for number in numbers):
        raise ValueError("a number is not finite")


def _devices(cell: Cell) -> dict[str, Any]:
    """Return the devices that remember something."""
    return {
        "stage": cell.stage, "robot": cell.robot, "jaws": cell.jaws,
        "lens": cell.lens, "light": cell.light,
    }  # fmt: skip


def _digest(cell: Cell) -> str:
    """Return a checksum of what the world was made from."""
    text = json.dumps(to_data(cell.truth.world))
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(state: Any) -> Any:
    """Return a generator's state without numpy's own types."""
    if isinstance(state, dict):
        return {k: _plain(v) for k, v in state.items()}
    return state.item() if isinstance(state, np.generic) else state
