"""Pictures of a part, measured from Python: drawing and workcell, no task, no plan."""

from __future__ import annotations

from microplan.featuresel.trials.chains import Chain
from microplan.planner.measure.measuring import PictureSeries
from microplan.planner.measure.part_task import STEP, PartCall, part_task
from microplan.planner.measure.picture_look import PictureLookCall, picture_look
from microplan.planner.source.diagnostics import CallError, Report
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.task.presets import Preset


def part_series(
    call: PartCall,
    *,
    chain: Chain | None = None,
    focus_um: float | None = None,
    bits: int | None = None,
    preset: Preset = "fast",
    report: Report | None = None,
    memo: Memo = EVERY_TIME,
) -> PictureSeries:
    """Return what measures pictures of a part, one after the other.

    Parameters
    ----------
    call : PartCall
        The part, and how its pictures were taken.
    chain : tuple of str, optional
        Routines to measure with. Default: the most accurate on images of the part.
    focus_um : float, optional
        World height in focus. Default: the target's.
    bits : int, optional
        Full scale of the pictures is 2**bits - 1. Default: that of the file.
    preset : Preset
        How much is spent on choosing routines.
    report : Report, optional
        Receives the findings, also those of single pictures later.
    memo : Memo
        Keeps what was chosen.

    Raises
    ------
    ValueError
        With the first finding, if the part cannot be read or measured.
    """
    report = report or Report()
    try:
        series = found_series(
            call, report, chain=chain, focus_um=focus_um, bits=bits, preset=preset,
            memo=memo,
        )  # fmt: skip
    except CallError as error:
        raise ValueError(f"{error.code}: {error} {error.hint}".rstrip()) from error
    if series is None:
        first = next(f for f in report.found if f.severity in ("error", "infeasible"))
        raise ValueError(f"{first.code}: {first.message} {first.hint}".rstrip())
    return series


def found_series(
    call: PartCall,
    report: Report,
    *,
    chain: Chain | None = None,
    focus_um: float | None = None,
    bits: int | None = None,
    preset: Preset = "fast",
    memo: Memo = EVERY_TIME,
) -> PictureSeries | None:
    """Return what `part_series` does; None, and findings, if it cannot be made.

    Raises
    ------
    CallError
        MP902, MP903 if the call leaves open what is to be measured.
    """
    asked = PictureLookCall(
        step=STEP, chain=chain, magnification=call.magnification,
        focus_um=focus_um, preset=preset, alone=True,
    )  # fmt: skip
    task = part_task(call, report)
    look = None if task is None else picture_look(task, asked, report, memo)
    if look is None:
        return None
    return PictureSeries(look=look, near=call.near, bits=bits, report=report)
