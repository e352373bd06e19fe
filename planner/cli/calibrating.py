"""`microplan calibrate`: what pictures tell of a camera, as lines of a workcell."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from microplan.planner.cli.answering import answered, asked_for
from microplan.planner.source.diagnostics import CallError, Report, Span

if TYPE_CHECKING:
    from microplan.planner.calibration.calibrated_value import (
        CalibratedValue,
        CalibrationSeries,
    )
    from microplan.planner.measure.part_task import PartCall
    from microplan.planner.source.schema import Checked

CODE = "MP904"


@answered
def calibrate(call: argparse.Namespace, report: Report) -> str:
    """Return what series of pictures tell, and write it if asked for."""
    from microplan.planner.calibration.calibrated_cell import (
        CalibrateCall,
        calibrated,
        calibrated_text,
        first_of_each,
    )
    from microplan.planner.store.folder import replace_bytes
    from microplan.planner.store.memo import Memo
    from microplan.planner.store.store import Store, place

    call.task = str(call.workcell)  # what findings are about
    _check_out(call.workcell, call.out)
    cell = _cell(call, report)
    if cell is None:
        return ""
    store = Store(place())
    asked = CalibrateCall(
        pictures=call.pictures,
        cell=cell,
        bits=call.bits,
        part=_part(call),
        memo=Memo(store),
    )
    series = calibrated(asked, report)
    store.trim()
    if report.failed or not series:
        return ""
    values, new = first_of_each(series, Span(file=str(call.workcell)), report), None
    if call.out is not None:
        text = call.workcell.read_text(encoding="utf-8")
        new = calibrated_text(text, values, call.out, report)
        if new is None:  # nothing is written, the page neither
            return ""
    said = "\n\n".join(map(_said, series))
    if call.report is not None:
        _report(call, series)
        said += f"\n\n{call.report} shows it"
    if new is None:
        return said + "\n\nwith -o FILE they are put into a workcell"
    replace_bytes(call.out, new.encode())
    return f"{said}\n\n{call.out} has {_as_many(len(values), series)}"


def _as_many(taken: int, series: Sequence[CalibrationSeries]) -> str:
    """Return how many values a workcell has of those that were found."""
    found = sum(len(each.values) for each in series)
    return "them" if taken == found else f"{taken} of {found} values"


def _report(call: argparse.Namespace, series: Sequence[CalibrationSeries]) -> None:
    """Write the page of what was found."""
    from microplan.planner.calibration.page.calibration_page import (
        write_calibration_page,
    )

    write_calibration_page(call.report, call.workcell.name, series)


def _part(call: argparse.Namespace) -> PartCall | None:
    """Return the part of a call, None if it names none."""
    if call.part is None:
        return None
    from microplan.planner.measure.part_task import PartCall

    return asked_for(PartCall, call)


def _cell(call: argparse.Namespace, report: Report) -> Checked | None:
    """Return the workcell, None if it is at fault."""
    from microplan.planner.source.schema import check
    from microplan.planner.source.source import read_source

    name = str(call.workcell)
    source = read_source(call.workcell, name, report, Span(file=name))
    if source is None:
        return None
    cell = check(source, "workcell", "microplan_workcell", report)
    return None if report.failed else cell


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


def _said(series: CalibrationSeries) -> str:
    """Return what a series tells, a line each."""
    numbers = [v for v in series.values if isinstance(v.value, float)]
    lines = [*map(_number, numbers), *series.notes]
    return "\n".join((series.heading, *(f"  {line}" for line in lines)))


def _number(value: CalibratedValue) -> str:
    """Return a value with its standard deviation, and what was stated."""
    unit = "" if value.unit == "1" else f" {value.unit}"
    (sigma,) = value.sigma
    words = f"{value.key}: {value.value:.5g}"
    words += f" +- {sigma:.2g}{unit}" if sigma is not None else unit
    if value.stated is not None:
        words += f"; stated {value.stated:.5g}"
        if value.pull is not None:
            words += f", {abs(value.pull):.2g} standard deviations off"
    return words
