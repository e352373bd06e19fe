"""The command microplan-run: read a plan, run it on a station, say how it went."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from microplan.executor.analysis.annotate import mark, write_marked
from microplan.executor.analysis.comparison import compare
from microplan.executor.analysis.comparison_report import (
    comparison_json,
    comparison_text,
)
from microplan.executor.analysis.picture_report import (
    report_json,
    report_text,
    together,
)
from microplan.executor.analysis.pictures import files_of, find_in, viewer
from microplan.executor.analysis.run_summaries import measured_regions, read_runs
from microplan.executor.cli.operator import asking_of
from microplan.executor.cli.options import RunOptions, parse
from microplan.executor.cli.replay import replay
from microplan.executor.cli.run_result import Ended, result_text
from microplan.executor.cli.select_station import Site, find_site
from microplan.executor.cli.session import RunJob, header_of, run_whole_plan
from microplan.executor.devices.errors import (
    BUG,
    CODES,
    DONE,
    FAILED,
    MACHINE,
    STOPPED,
    ExecutorError,
)
from microplan.executor.devices.station import preflight
from microplan.executor.devices.station_file import is_file
from microplan.executor.record.listing import plan_lines
from microplan.executor.record.plan_file import PlanFile, read_plan
from microplan.executor.record.recorded_calls import read_record, records_of
from microplan.executor.record.run_folder import (
    RunFolder,
    check_free,
    check_same,
    lock_beside,
    new_run,
    old_run,
)
from microplan.executor.run.artifacts import Artifacts
from microplan.schemas.page.console import OutputLostError, flush, say, tell
from microplan.schemas.plan import Plan, newer_note


def main(argv: Sequence[str] | None = None) -> int:
    """Return the exit status: 0 done, 1 no, 2 input, 3 machine, 4 stopped, 70 a bug."""
    _hold_streams()
    try:
        status = _status(argv)
        flush()
    except OutputLostError as error:
        tell(f"error: {error}")
        return MACHINE
    except Exception as error:  # the one place that catches everything
        tell(f"bug in microplan: {type(error).__name__}: {error}")
        return BUG
    return status


def _hold_streams() -> None:
    """Open replacements of standard streams that are closed.

    Else the journal would get one of their numbers, and libraries write there.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free


def _status(argv: Sequence[str] | None) -> int:
    """Do what was asked for; return the exit status."""
    try:
        options = parse(argv)
    except SystemExit as leaving:  # argparse: 0 after --help, 2 for a wrong call
        return int(leaving.code or 0)
    try:
        return _run(options)
    except ExecutorError as error:
        _tell(error, options.plan_file)
        return error.exit_status
    except KeyboardInterrupt:
        stopped = ExecutorError("MP860", "stopped while nothing was in motion")
        _tell(stopped, options.plan_file)
        return stopped.exit_status


def _run(options: RunOptions) -> int:
    """Do what was asked; errors are the caller's to report."""
    file = read_plan(options.plan_file)
    if note := newer_note(file.plan):
        tell(f"note: {note}")
    if options.mode == "compare":
        return _compare(options, file)
    if options.mode == "report" and options.record is not None:
        from microplan.executor.analysis.run_report import write_report

        say(f"report: {write_report(options.record)}")
        return DONE
    if options.record is not None:
        return _replay(options, file, options.record)
    if options.pictures is not None:
        return _look_at_pictures(options, file.plan, options.pictures)
    with ExitStack() as stack:
        if options.station_file is not None and is_file(options.station_file):
            stack.enter_context(lock_beside(options.station_file))
        return _on_station(options, file, stack)


def _on_station(options: RunOptions, file: PlanFile, stack: ExitStack) -> int:
    """Check, list, run or resume the plan on its station."""
    plan = file.plan
    path = options.run_dir or options.folder.parent / f"{plan.name}.run"
    if options.resume:
        return _resume(options, file, stack.enter_context(old_run(path)))
    if options.mode == "run":
        check_free(path, discard=options.discard)
    site = _site(options, plan, None)
    preflight(plan, site.station)
    artifacts = Artifacts.from_folder(plan, options.folder)
    if options.mode == "check":
        say(f"{plan.name}: {len(plan.steps)} steps fit the station")
        return DONE
    if options.mode == "dry-run":
        say("\n".join(plan_lines(plan)))
        return DONE
    asking = asking_of(options, plan)
    run = stack.enter_context(new_run(path, discard=options.discard))
    run.begin(options.plan_file, file.source, site.source)
    job = RunJob(options=options, file=file, site=site, artifacts=artifacts, run=run)
    return _report(options, plan, run_whole_plan(job, asking))


def _resume(options: RunOptions, file: PlanFile, run: RunFolder) -> int:
    """Go on with the run of a folder."""
    then = run.header
    seed = then.seed if options.seed is None else options.seed
    seen_by = then.camera or ("quick" if options.station_file is None else None)
    options = replace(
        options,
        seed=seed,
        faults=options.faults or then.faults,
        camera=options.camera or seen_by,
    )
    # before a driver is touched
    check_same(header_of(options, file, then.devices), then)
    site = _site(options, file.plan, run.cell)
    devices = site.station.devices()
    check_same(header_of(options, file, devices, site.source), then)
    preflight(file.plan, site.station, begun=True)
    artifacts = Artifacts.from_folder(file.plan, options.folder)
    job = RunJob(options=options, file=file, site=site, artifacts=artifacts, run=run)
    return _report(
        options, file.plan, run_whole_plan(job, asking_of(options, file.plan))
    )


def _site(options: RunOptions, plan: Plan, left: Path | None) -> Site:
    """Return the station that was asked for; `left` is a simulated cell's world."""
    seed, faults = options.seed or 0, options.faults
    steps = [step.id for step in plan.steps]
    for fault in faults:
        step = fault.partition("@")[2]
        if step and step not in steps:
            known = ", ".join(steps)
            raise ExecutorError(
                "MP804", f"{fault}: the plan has no step {step!r}; it has {known}"
            )
    return find_site(
        options.station, options.folder, seed=seed, faults=faults,
        camera=options.camera, left=left,
    )  # fmt: skip


def _report(options: RunOptions, plan: Plan, ended: Ended) -> int:
    """Print table, findings and verdicts; return the exit status."""
    result, verdict = ended.result, ended.verdict
    say(result_text(ended))
    say(f"run folder: {ended.folder}")
    _write_report(ended.folder)
    if verdict is not None:
        truly = "seated" if verdict.success else "not seated"
        say(
            f"the cell's own verdict: {truly}, offset {verdict.offset_um:.3g} um, "
            f"height {verdict.height_um:.3g} um"
            + (f", {verdict.collided}" if verdict.collided else "")
            + (", still held" if verdict.held else "")
        )
    if result.code is None:
        say(f"{plan.name}: done in {result.time_s:.1f} s")
        return DONE
    where = f"step {result.step}: " if result.step else ""
    _tell(ExecutorError(result.code, where + result.message), options.plan_file)
    if CODES[result.code][1] == STOPPED:
        say(f"{plan.name}: stopped; --resume goes on with it")
        return STOPPED
    say(f"{plan.name}: failed")
    return CODES[result.code][1]


def _write_report(folder: Path) -> None:
    """Write the run's report; one that cannot be written changes no outcome."""
    # loaded only when it is written
    from microplan.executor.analysis.run_report import write_report

    try:
        say(f"report: {write_report(folder)}")
    except ExecutorError as error:
        tell(f"note: no report: {error.message}")


def _replay(options: RunOptions, file: PlanFile, folder: Path) -> int:
    """Run the plan on a run's records and say whether the commands are the same."""
    artifacts = Artifacts.from_folder(file.plan, options.folder)
    paths = records_of(folder)
    for path in paths:
        which = f"{path.name}: " if len(paths) > 1 else ""
        found = replay(file, artifacts, read_record(path), anyway=options.anyway)
        say(f"{which}{found.same} of {found.commands} commands are the same")
        if found.difference:
            raise ExecutorError("MP876", which + found.difference)
        ended = "the record breaks off there" if found.broken_off else found.result.code
        say(f"{which}{file.plan.name}: replayed, {ended or 'done'}")
    return DONE


def _look_at_pictures(options: RunOptions, plan: Plan, pictures: Path) -> int:
    """Measure a folder of pictures; 0 if the target was found in all of them."""
    folder, look = options.folder, options.look
    artifacts = Artifacts.from_folder(plan, folder)
    seer = viewer(
        plan, folder, artifacts, look, turn_rad=options.turn_rad, bits=options.bits
    )
    files = files_of(pictures)
    marked = options.marked or pictures.absolute().with_name(f"{look}.marked")
    if marked.absolute() == pictures.absolute():
        raise ExecutorError("MP878", f"{marked} holds the pictures themselves")
    regions = measured_regions(pictures, look)
    findings = []
    for path in files:
        own = seer.reading(regions.get(path.name))
        found = find_in(own, path)
        if (picture := mark(own, found, folder)) is not None:
            write_marked(marked, path.name, picture)
        findings.append(replace(found, image=None))
    overall = together(seer, findings, still=options.still)
    report = report_json if options.format == "json" else report_text
    say(report(seer, findings, overall))
    tell(f"marked pictures: {marked}")
    return DONE if all(f.found for f in findings) and not overall.refuted else FAILED


def _compare(options: RunOptions, file: PlanFile) -> int:
    """Join runs of the plan; 1 if they refute what it predicted."""
    found = compare(file.plan, read_runs(options.runs, file))
    report = comparison_json if options.format == "json" else comparison_text
    say(report(file.plan, found))
    return FAILED if found.refuted else DONE


def _tell(error: ExecutorError, plan_file: Path) -> None:
    """Print a finding."""
    for each in (error, *error.others):
        tell(f"error[{each.code}]: {each.message}")
        tell(f"  --> {each.place or plan_file}")
    tell(f"   = {CODES[error.code][0]}")
    tell(f"   = more: microplan explain {error.code}")


if __name__ == "__main__":
    sys.exit(main())
