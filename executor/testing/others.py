"""Conformance checks of what does not move: camera, light, clock."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from microplan.executor.devices.drivers import Frame
from microplan.executor.testing.bench import (
    BAD,
    Bench,
    Check,
    ConformanceError,
    identity,
    must,
)
from microplan.schemas.plan import Region

AHEAD_S = 0.2  # how far in the future a frame is asked for


def _grab(device: Any, bench: Bench, region: Region | None, after_s: float) -> Frame:
    """Return a frame."""
    frame = bench.call("grab", lambda: device.grab(region, after_s=after_s))
    if not isinstance(frame, Frame):
        raise ConformanceError(f"grab returned {type(frame).__name__}, not a Frame")
    must(math.isfinite(frame.exposed_s), f"the exposure's time is {frame.exposed_s}")
    return frame


def _counts(device: Any, bench: Bench) -> None:
    """A frame holds rows and columns of whole counts."""
    counts = _grab(device, bench, None, bench.clock.now_s()).counts
    must(counts.ndim == 2, f"a frame has shape {counts.shape}, not (rows, columns)")
    kinds = (np.dtype(np.uint8), np.dtype(np.uint16))
    must(counts.dtype in kinds, f"a frame has {counts.dtype}, not uint8 or uint16")


def _region(device: Any, bench: Bench) -> None:
    """A region has the size that was asked for."""
    rows, columns = _grab(device, bench, None, bench.clock.now_s()).counts.shape
    region = Region(
        row=rows // 4, column=columns // 3, rows=rows // 2, columns=columns // 4
    )
    part = _grab(device, bench, region, bench.clock.now_s()).counts
    wanted = (region.rows, region.columns)
    must(part.shape == wanted, f"a region has {part.shape} pixels, not {wanted}")


def _fresh(device: Any, bench: Bench) -> None:
    """No frame is older than asked for, also if that is a moment ahead."""
    for ahead_s in (0.0, AHEAD_S):
        after_s = bench.clock.now_s() + ahead_s
        frame = _grab(device, bench, None, after_s)
        must(
            frame.exposed_s >= after_s,
            f"a stale frame: exposed {after_s - frame.exposed_s:.4g} s before the time "
            "asked for",
        )
        now_s = bench.clock.now_s()
        must(frame.exposed_s <= now_s, "a frame was exposed in the future")


def _own(device: Any, bench: Bench) -> None:
    """A frame stays as it is when the next one comes."""
    first = _grab(device, bench, None, bench.clock.now_s()).counts
    kept = first.copy()
    _grab(device, bench, None, bench.clock.now_s())
    must(bool(np.array_equal(first, kept)), "the next frame overwrites the last one")


def _levels(device: Any, bench: Bench) -> None:
    """Levels from dark to full are taken, others refused."""
    for level in (0.0, 1.0):
        bench.call("set_level", lambda level=level: device.set_level(level))  # type: ignore[misc]  # a bound name
    for value in BAD:
        bench.refused(
            f"set_level({value})",
            lambda value=value: device.set_level(value),  # type: ignore[misc]  # a bound name
        )


def _runs(device: Any, bench: Bench) -> None:
    """Waiting moves the clock on by as much at least."""
    before_s = bench.call("now_s", device.now_s)
    bench.call("wait", lambda: device.wait(0.05))
    after_s = bench.call("now_s", device.now_s)
    must(after_s - before_s >= 0.05 - 1e-9, f"wait(.05) took {after_s - before_s:g} s")


CAMERA: Mapping[str, Check] = {
    "says what it is": identity,
    "gives whole counts": _counts,
    "gives the region asked for": _region,
    "gives no stale frame": _fresh,
    "gives frames of their own": _own,
}
LIGHT: Mapping[str, Check] = {"says what it is": identity, "takes levels": _levels}
CLOCK: Mapping[str, Check] = {"runs": _runs}
