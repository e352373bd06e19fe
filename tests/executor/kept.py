"""One good run of the whole job on the simulated cell, frames kept, for many tests."""

from __future__ import annotations

import contextlib
import io
from dataclasses import replace
from pathlib import Path

from microplan.executor.cli.main import main
from tests.executor.bench import QUICK, Folder, assembly, world

PLAN, RUN, SAID = "gear.plan", "gear.run", "gear.txt"


def keep_run(folder: Path) -> None:
    """Put plan, run and what it printed into a folder; the gear lies near its place."""
    maker = Folder(folder / PLAN)
    found = world()
    parts = tuple(replace(p, sigma_xy_um=min(p.sigma_xy_um, 8.0)) for p in found.parts)
    maker.write(assembly(maker), replace(found, parts=parts))
    call = [str(folder / PLAN), *QUICK, "--seed", "3"]
    with contextlib.redirect_stdout(io.StringIO()) as heard:
        status = main([*call, "--run-dir", str(folder / RUN)])
    assert status == 0, heard.getvalue()
    (folder / SAID).write_text(heard.getvalue(), encoding="utf-8")
