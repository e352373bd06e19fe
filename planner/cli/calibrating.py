"""`microplan calibrate`: what pictures tell of a camera, as lines of a workcell."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from microplan.planner.cli.answering import answered
from microplan.planner.source.diagnostics import CallError, Report, Span

if TYPE_CHECKING:
    from microplan.planner.calibration.picture_series import NoiseByLevel

CODE = "MP904"


@answered
def calibrate(call: argparse.Namespace, report: Report) -> str:
    """Return what pictures of a still scene tell, and write it if asked for."""
    from microplan.planner.calibration.picture_series import camera_noise
    from microplan.planner.measure.picture_files import files_of
    from microplan.planner.source.schema import check
    from microplan.planner.source.source import read_source
    from microplan.planner.store.folder import replace_bytes
    from microplan.planner.task.camera.check_camera import BITS

    call.task = str(call.workcell)  # what findings are about
    _check_out(call.workcell, call.out)
    name = str(call.workcell)
    source = read_source(call.workcell, name, report, Span(file=name))
    if source is None:
        return ""
    cell = check(source, "workcell", "microplan_workcell", report)
    if report.failed:
        return ""
    bits = int(cell.source.get("camera", "bits") or BITS)
    found = camera_noise(files_of(call.pictures), bits, call.bits, report)
    if found is None or report.failed:
        return ""
    if call.out is None:
        return _said(found) + "\n\nwith -o FILE they are put into a workcell"
    text = call.workcell.read_text(encoding="utf-8")
    replace_bytes(call.out, _written(text, found).encode())
    return f"{_said(found)}\n\n{call.out} has them"


def _check_out(workcell: Path, out: Path | None) -> None:
    """Raise a CallError if drawings would not be found from the new workcell."""
    if out is not None and out.parent.resolve() != workcell.parent.resolve():
        message = f"{out} is not in the folder of {workcell}"
        hint = "write it beside the workcell: it names drawings from there"
        raise CallError(CODE, message, out, hint)
    if out is not None and out.exists() and b"microplan_workcell" not in _held(out):
        message = f"{out} is there already, and no workcell; it is left untouched"
        raise CallError("MP703", message, out)


def _held(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError:
        return b""  # what is not readable is not replaced


def _said(found: NoiseByLevel) -> str:
    """Return the noise by level, a line each."""
    lines = [f"noise in {found.frames} pictures, counts (standard deviation)"]
    for row in found.rows:
        noise = row.variance**0.5
        words = f"  at {row.level:8.1f}: {noise:.3g}"
        if row.sigma is not None:
            words += f" +- {row.sigma / 2 / noise:.2g}"
        lines.append(words)
    return "\n".join(lines)


def _written(text: str, found: NoiseByLevel) -> str:
    """Return the workcell's text with the noise in it."""
    from microplan.planner.calibration.workcell_lines import with_noise_table

    rows = ", ".join(f"[{row.level:.6g}, {row.variance:.4g}]" for row in found.rows)
    said = {
        "method": "differences of successive pictures of a still scene",
        "pictures": found.frames,
        "sha256": found.sha256,
        "sigma": [
            None if row.sigma is None else float(f"{row.sigma:.3g}")
            for row in found.rows
        ],
    }
    return with_noise_table(text, f"[{rows}]", {"noise_table": said})
