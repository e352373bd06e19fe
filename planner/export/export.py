"""`microplan export`: a plan written in another tool's format."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from microplan.planner.diff.diffing import plan_file
from microplan.planner.export.folder import ExportedPlan, read_folder
from microplan.planner.export.pieces import look_outlines
from microplan.planner.export.sequence import sequence, sequence_json, sequence_yaml
from microplan.planner.export.writing import (
    check_free,
    file_names,
    write_file,
    write_folder,
)
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.store.folder import OutputError
from microplan.schemas.codec import to_data
from microplan.schemas.files.outlines import Outlines

Format = Literal["dxf", "json", "ome-tiff", "useq"]

DIGITS = 12  # of an outline: nine would make 2 pi more than a circle
_FOLDERS = {"dxf": ".dxf", "ome-tiff": ".ome.tiff"}  # a file a look
_FILES = {"json": (".json",), "useq": (".yaml", ".yml", ".json")}


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportCall:
    """What is exported, as what, and where to."""

    plan: Path  # plan.json, or the folder it is in
    to: Format
    out: Path
    looks: tuple[str, ...] = ()  # ids; (): all
    channel: str | None = None  # of a sequence
    overwrite: bool = False


def export(call: ExportCall, report: Report) -> str:
    """Write an export and return what was written.

    Reports MP722 if the plan is infeasible: what its looks see is predicted alike.

    Raises
    ------
    ExportError
        MP704, MP720, MP721: see `microplan.planner.export.folder`.
    OutputError
        MP702 or MP703 if it cannot be written, or something is there already.
    """
    _check_place(call)
    folder = read_folder(call.plan, call.looks)
    if folder.plan.status == "infeasible":
        report.warning(
            "MP722",
            Span(file=str(plan_file(call.plan))),
            f"plan {folder.plan.name!r} is infeasible: "
            + "; ".join(f"{why.code} {why.message}" for why in folder.plan.reasons),
            "its looks are exported all the same",
        )
    if call.to in _FOLDERS:
        return _write_each(call, folder)
    write_file(call.out, _whole(call, folder), overwrite=call.overwrite)
    return f"{_looks(len(folder.looks))} as {call.to}: {call.out}"


def _check_place(call: ExportCall) -> None:
    """Raise OutputError before the work if its result could not be put anywhere."""
    if call.to in _FILES and call.out.suffix.lower() not in _FILES[call.to]:
        raise OutputError(
            "MP702",
            f"{call.out}: {call.to} is written to {', '.join(_FILES[call.to])}",
            call.out,
        )
    check_free(call.out, folder=call.to in _FOLDERS, overwrite=call.overwrite)


def _whole(call: ExportCall, folder: ExportedPlan) -> bytes:
    """Return the one file that holds all looks."""
    if call.to == "json":
        text = json.dumps(to_data(outlines(folder), DIGITS), indent=2)
        return (text + "\n").encode()
    data = sequence(folder, channel=call.channel)
    if call.out.suffix.lower() == ".json":
        return sequence_json(data)
    return sequence_yaml(data)


def _write_each(call: ExportCall, folder: ExportedPlan) -> str:
    """Write a folder with a file a look."""
    ids = [viewed.look.id for viewed in folder.looks]
    names = file_names(ids, _FOLDERS[call.to])
    if call.to == "dxf":
        from microplan.planner.export.dxf import dxf  # ezdxf takes a second

        found = outlines(folder)
        made = [dxf(found, look) for look in found.looks]
    else:
        from microplan.planner.export.ome import ome_tiff

        made = [ome_tiff(folder, viewed) for viewed in folder.looks]
    index = {
        "export": call.to,
        "plan": folder.plan.name,
        "status": folder.plan.status,
        "simulated": True,
        "files": [
            {
                "file": name,
                "look": viewed.look.id,
                "step": viewed.step.id,
                "target": viewed.scene.target.name,
                "um_per_px": viewed.look.view.um_per_px,
                "image_sha256": viewed.look.scene.image_sha256,
            }
            for name, viewed in zip(names, folder.looks, strict=True)
        ],
    }
    files = dict(zip(names, made, strict=True))
    write_folder(call.out, files, index, overwrite=call.overwrite)
    return f"{_looks(len(ids))} as {call.to}: {call.out}"


def outlines(folder: ExportedPlan) -> Outlines:
    """Return the outlines of all looks of a folder."""
    return Outlines(
        plan=folder.plan.name,
        # a sketch has no looks
        status="feasible" if folder.plan.status == "feasible" else "infeasible",
        looks=tuple(look_outlines(folder, viewed) for viewed in folder.looks),
    )


def _looks(count: int) -> str:
    return f"{count} look" + ("" if count == 1 else "s")
