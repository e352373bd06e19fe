"""`microplan diff`: two plans read, compared, reported."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from microplan.planner.diff.changes import Kind, PlanChange
from microplan.planner.diff.compare import compare_plans
from microplan.planner.diff.pictures import compare_pictures
from microplan.planner.diff.tolerances import Rule
from microplan.planner.source.diagnostics import CallError
from microplan.planner.store.folder import (
    check_file,
    check_folder,
    replace_file,
    replace_folder,
)
from microplan.schemas.codec import CodecError
from microplan.schemas.plan import Plan, newer_note, parse_plan


class DiffError(CallError):
    """A plan that cannot be compared; carries the code of its finding."""


MOST_BYTES = 1 << 26  # of a plan.json: some 64 MiB


@dataclass(frozen=True, slots=True, kw_only=True)
class DiffCall:
    """What is compared, and how."""

    old: Path  # plan.json, or the folder it is in
    new: Path
    rules: Sequence[Rule] = ()
    fail_on: Sequence[Kind | str] = ()  # kinds, or "worse"; (): any change
    pictures: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """What changed, and what of it fails the comparison."""

    changes: tuple[PlanChange, ...]
    failing: tuple[PlanChange, ...]
    notes: tuple[str, ...] = ()  # on what could not be compared
    old: Plan
    new: Plan


def diff(call: DiffCall) -> Difference:
    """Return the differences of two plans.

    Raises
    ------
    DiffError
        MP704 if one cannot be read.
    """
    old, new = read_plan(call.old), read_plan(call.new)
    changes = [*compare_plans(old, new, call.rules)]
    if call.pictures:
        folders = [plan_file(path).parent for path in (call.old, call.new)]
        changes += compare_pictures(old, folders[0], new, folders[1])
    failing = tuple(c for c in changes if _fails(c, call.fail_on))
    told = (
        (path, newer_note(plan)) for path, plan in ((call.old, old), (call.new, new))
    )
    notes = tuple(f"{path}: {note}" for path, note in told if note)
    return Difference(
        changes=tuple(changes), failing=failing, notes=notes, old=old, new=new
    )


def diff_with_golden(
    plan: Plan, folder: Path, golden: Path, rules: Sequence[Rule] = ()
) -> Difference:
    """Return in what a plan just compiled differs from a golden one.

    Pictures are compared if the golden plan's folder has any: a plan.json may be kept
    alone.

    Raises
    ------
    DiffError
        MP704 if the golden plan cannot be read.
    """
    old = read_plan(golden)
    changes = [*compare_plans(old, plan, rules)]
    if has_pictures(golden):
        changes += compare_pictures(old, plan_file(golden).parent, plan, folder)
    found = tuple(changes)
    return Difference(changes=found, failing=found, old=old, new=plan)


def has_pictures(golden: Path) -> bool:
    """Return whether pictures were kept with a golden plan."""
    return (plan_file(golden).parent / "images").is_dir()


def renew_golden(folder: Path, golden: Path) -> None:
    """Replace the golden plan by a plan folder, or by its plan.json.

    Raises
    ------
    OutputError
        MP701 if what is there is no plan, MP702 if it cannot be written.
    """
    check_golden(golden)
    if golden.suffix == ".json":
        replace_file(folder / "plan.json", golden)
    else:
        replace_folder(folder, golden)


def check_golden(golden: Path) -> None:
    """Raise OutputError if a plan may not be put there: MP701 if it is something else.

    MP702 if that cannot be found out.
    """
    if golden.suffix == ".json":
        check_file(golden)
    else:
        check_folder(golden)


def plan_file(path: Path) -> Path:
    """Return the plan.json that a path names or holds."""
    is_folder = os.path.isdir(path)  # noqa: PTH112 - Path's raises if it may not look
    return path / "plan.json" if is_folder else path


def read_plan(path: Path) -> Plan:
    """Return a plan; raise DiffError if there is none that can be read."""
    file = plan_file(path)
    try:
        with file.open("rb") as stream:
            data = stream.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise DiffError("MP704", f"larger than {MOST_BYTES} bytes", str(file))
        return parse_plan(data.decode("utf-8"))
    except OSError as error:
        raise DiffError(
            "MP704", f"cannot read {file}: {error.strerror}", str(file)
        ) from error
    except (UnicodeDecodeError, CodecError) as error:
        raise DiffError("MP704", f"{file} is no plan: {error}", str(file)) from error


def _fails(change: PlanChange, fail_on: Sequence[str]) -> bool:
    """Return whether a change is one that the comparison is to fail on."""
    return not fail_on or change.kind in fail_on or change.trend in fail_on
