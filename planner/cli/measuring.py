"""`microplan measure`: the pose of a step's target in pictures, without a plan."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from microplan.planner.cli.answering import (
    DONE,
    NO,
    answer,
    asked_for,
    refuse,
    tell_progress,
)
from microplan.planner.source.diagnostics import CallError, Report
from microplan.schemas.page.console import one_line, say, tell

if TYPE_CHECKING:
    from microplan.planner.measure.answer_lines import AnswerTally
    from microplan.planner.measure.picture_files import PictureError
    from microplan.planner.measure.picture_look import PictureLook
    from microplan.planner.task.task import Task


def measure(call: argparse.Namespace) -> int:
    """Measure pictures; a line each as soon as it is known."""
    report = Report()
    is_refused = False
    try:
        tally = _measured(call, report)
        is_refused = tally is not None and not tally.all_accepted
    except CallError as error:
        call.task = call.task or call.part or "microplan measure"
        refuse(call, report, error)
    status = answer(call, report, "")
    return NO if status == DONE and is_refused else status


def _measured(call: argparse.Namespace, report: Report) -> AnswerTally | None:
    """Return what was found in all pictures, None if none could be measured."""
    from microplan.planner.measure.measuring import report_unusable
    from microplan.planner.measure.picture_files import PictureError, files_of
    from microplan.planner.measure.picture_look import check_chain

    task = _task(call, report)
    if task is None:
        return None
    check_chain(call.chain)
    files = files_of(call.pictures)
    wrong = [file for file in files if isinstance(file, PictureError)]
    if call.mark is not None:
        from microplan.planner.measure.marking import check_marks

        check_marks(call.mark, [f for f in files if not isinstance(f, PictureError)])
    if len(wrong) == len(files):  # no need to make a look ready
        for each in wrong:
            report_unusable(each, report)
        return None
    look = _look(task, call, report)
    return None if look is None else _each(look, files, call, report)


def _task(call: argparse.Namespace, report: Report) -> Task | None:
    """Return the task that a call names, or that of a part alone; None if at fault."""
    if (call.task is None) == (call.part is None):
        raise CallError("MP903", "either --task with --step is needed, or --part")
    for name in ("step", "workcell"):
        other = "task" if name == "step" else "part"
        if (getattr(call, name) is None) != (getattr(call, other) is None):
            raise CallError("MP903", f"--{other} and --{name} belong together")
    if call.part is not None:
        from microplan.planner.measure.part_task import STEP, PartCall, part_task

        call.step = STEP
        return part_task(asked_for(PartCall, call), report)
    for name in ("target", "height_um", "units", "layers", "faces", "cell", "polarity"):
        if getattr(call, name) is not None:
            option = name.replace("_", "-")
            raise CallError("MP903", f"--{option} is of --part: the task states it")
    from microplan.planner.task.read_task import load_task

    return load_task(call.task, report)


def _look(task: Task, call: argparse.Namespace, report: Report) -> PictureLook | None:
    """Return the look made ready, by what earlier calls kept; None if it cannot be."""
    from microplan.planner.measure.picture_look import PictureLookCall, picture_look
    from microplan.planner.store.memo import Memo
    from microplan.planner.store.store import Store, place

    store = Store(place())
    asked = asked_for(PictureLookCall, call, alone=call.part is not None)
    look = picture_look(task, asked, report, Memo(store), tell_progress)
    store.trim()
    return look


def _each(
    look: PictureLook,
    files: Sequence[Path | PictureError],
    call: argparse.Namespace,
    report: Report,
) -> AnswerTally:
    """Measure picture by picture; print, and mark if asked for."""
    from microplan.planner.measure.answer_lines import (
        GREY,
        AnswerTally,
        json_line,
        text_line,
    )
    from microplan.planner.measure.measuring import PictureSeries

    marks = None
    if call.mark is not None:
        from microplan.planner.measure.marking import MarkedFolder

        marks = MarkedFolder(folder=call.mark)
    series = PictureSeries(look=look, near=call.near, bits=call.bits, report=report)
    tally = AnswerTally()
    for found in series.measured(files):
        tally.add(found)
        line = text_line(look, found, verbose=call.verbose)
        say(json_line(look, found) if call.json else one_line(line))
        if marks is not None:
            marks.write(found)
    if tally.count and not call.json:
        say(tally.closing(look))
    if series.colours:
        (tell if call.json else say)(GREY)
    return tally
