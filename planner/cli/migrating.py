"""`microplan migrate`: a task or workcell of an older format in the newest."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from microplan.planner.source.diagnostics import Report
from microplan.planner.source.migrations import migrated
from microplan.planner.store.folder import OutputError, replace_text


@dataclass(frozen=True, slots=True, kw_only=True)
class MigrateCall:
    """Which file, and where the new one goes."""

    file: str
    out: Path | None = None  # a file that is not there yet; None: standard output
    in_place: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """What goes to standard output, and what is said beside it."""

    text: str
    said: str


def migrate(call: MigrateCall, report: Report) -> Told | None:
    """Return what was made of a file, None if why not was reported.

    The file itself is replaced only if that is asked for.

    Raises
    ------
    OutputError
        MP703 if `out` is there already, MP702 if it cannot be written.
    """
    found = migrated(Path(call.file), call.file, report)
    if found is None:
        return None
    said = "\n".join(found.says) or f"{call.file} is of the newest version already"
    if call.out is not None:
        if os.path.lexists(call.out):
            raise OutputError("MP703", f"{call.out} is there already", call.out)
        replace_text(call.out, found.text)
    elif call.in_place:
        if found.says:
            replace_text(Path(call.file), found.text)
    else:
        return Told(text=found.text, said=said)
    return Told(text="", said=said)
