"""Every routine against the limit: python -m benchmarks.localisation.table.

Each alone, from where it would start: what searches from the nominal place, what needs
a start from one as good as a coarse routine gives. Truth is another blur law than the
one that routines are prepared with; bias counts in the rms.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy is loaded, so that times compare

from benchmarks.localisation.points import HEIGHTS_UM  # noqa: E402 - see above
from benchmarks.localisation.record import (  # noqa: E402
    RECORD,
    code_of,
    key_of,
    record,
    recorded,
)
from benchmarks.localisation.rows import LIMIT, Row, rows  # noqa: E402
from benchmarks.localisation.scenes import ACROSS, SCENES  # noqa: E402
from microplan.featuresel.routines.registry import REGISTRY, load  # noqa: E402

TRIALS = 100
SHOWN = ("plain", "all")
_CELL = "{:.2g}"
Todo = tuple[str, str, tuple[str, ...]]  # scene, condition, routines


def lines(scene: str, found: Sequence[Row], trials: int) -> Iterator[str]:
    """Yield a scene's table, in which the limit is 1."""
    heights = [f"{z:g}" for z in HEIGHTS_UM]
    yield f"\n### {scene}, up to {trials} trials a point\n"
    kind = SCENES[scene]().target.kind
    place, turned = "across" if kind in ACROSS else "x", kind != "circle"
    head = ["routine", "condition", *(f"{place} {z}" for z in heights)]
    head += [f"theta {z}" for z in heights] if turned else []
    head += ["trials", "right", "silent", "fails mostly as", "ms"]
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in found:
        shown = "limit, nm, mdeg" if row.routine == LIMIT else f"`{row.routine}`"
        cells = [shown, row.condition]
        if row.refused:
            cells += [f"not prepared: {row.refused}"] + [""] * (len(head) - 3)
        else:
            cells += [_cell(v) for v in row.ratio_x]
            cells += [_cell(v) for v in row.ratio_theta] if turned else []
            cells += [str(row.trials // len(HEIGHTS_UM)) if row.trials else ""]
            cells += [_share(n, row.trials) for n in (row.right, row.silent)]
            cells += [_mostly(row.codes), _cell(row.ms)]
        yield "| " + " | ".join(cells) + " |"


def _share(count: int, trials: int) -> str:
    """Return a share in percent, nothing of no trials."""
    return f"{count / trials:.0%}" if trials else ""


def _mostly(codes: Sequence[str]) -> str:
    """Return the commonest code, the first by name among equals."""
    return max(sorted(set(codes)), key=codes.count, default="")


def _cell(value: float) -> str:
    """Return two digits, whole numbers from 100 on, nothing of a nan."""
    if math.isnan(value):
        return ""
    return f"{value:.0f}" if value >= 100 else _CELL.format(value)


def measure_all(
    wanted: Sequence[Todo], trials: int, jobs: int, path: Path
) -> Iterator[Row]:
    """Yield all rows wanted, those that are recorded without measuring them again."""
    known, keys = recorded(path), _keys(wanted, trials)
    left = []
    for todo in wanted:
        scene, condition, names = todo
        found = {n: known.get(keys[scene, condition, n]) for n in (LIMIT, *names)}
        yield from (_read(value) for value in found.values() if value is not None)
        missing = tuple(n for n in names if found[n] is None)
        if missing or found[LIMIT] is None:
            left.append((scene, condition, missing))
    for some in _worked(left, trials, jobs):
        for row in some:
            key = keys[row.scene, row.condition, row.routine]
            if key not in known:
                record(path, key, _written(row))
                yield row


def _worked(left: Sequence[Todo], trials: int, jobs: int) -> Iterator[list[Row]]:
    """Yield the rows of one scene and condition after the other, as they are done."""
    work = partial(_rows_of, trials=trials)
    if jobs == 1 or len(left) < 2:
        yield from map(work, left)
        return
    # spawned, as a process forked from one with threads may hang
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        yield from pool.imap_unordered(work, left)


def _rows_of(todo: Todo, trials: int) -> list[Row]:
    return rows(todo[:2], todo[2], trials)


def _keys(wanted: Sequence[Todo], trials: int) -> dict[tuple[str, str, str], str]:
    """Return the key of every row: what it shows, and the code that it comes from."""
    codes: dict[str, str] = {}
    keys = {}
    for scene, condition, names in wanted:
        for name in (LIMIT, *names):
            if name not in codes:
                own = () if name == LIMIT else (load(name).__name__,)  # type: ignore[attr-defined] # a module
                codes[name] = code_of("benchmarks.localisation.rows", *own)
            settings = {"row": name, "scene": scene, "condition": condition}
            keys[scene, condition, name] = key_of(
                {**settings, "trials": trials}, codes[name]
            )
    return keys


def _written(row: Row) -> dict[str, Any]:
    """Return a row for the record, with nothing for nan."""

    def plain(value: Any) -> Any:
        if isinstance(value, tuple):
            return [plain(v) for v in value]
        nothing = isinstance(value, float) and math.isnan(value)
        return None if nothing else value

    return {name: plain(value) for name, value in asdict(row).items()}


def _read(value: Mapping[str, Any]) -> Row:
    """Return a row as recorded."""

    def full(name: str, each: Any) -> Any:
        if isinstance(each, list):
            return tuple(full(name, v) for v in each)
        return math.nan if each is None else each

    return Row(**{name: full(name, each) for name, each in value.items()})


def main(argv: Sequence[str] | None = None) -> int:
    """Print a table per scene."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.localisation.table")
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--scene", choices=list(SCENES), action="append")
    parser.add_argument("--routine", choices=sorted(REGISTRY), action="append")
    parser.add_argument("--record", type=Path, default=RECORD)
    call = parser.parse_args(argv)
    wanted: list[Todo] = []
    for scene in call.scene or SCENES:
        kind = SCENES[scene]().target.kind
        names = sorted(call.routine or REGISTRY)
        mine = tuple(name for name in names if kind in load(name).kinds)
        wanted += [(scene, condition, mine) for condition in SHOWN]
    done = []
    for row in measure_all(wanted, call.trials, call.jobs, call.record):
        done.append(row)
        print(f"{row.scene} {row.condition} {row.routine}", file=sys.stderr, flush=True)
    for scene in dict.fromkeys(todo[0] for todo in wanted):
        mine_rows = [row for row in done if row.scene == scene]
        mine_rows.sort(key=_order)
        print("\n".join(lines(scene, mine_rows, call.trials)), flush=True)
    return 0


def _order(row: Row) -> tuple[bool, str, int]:
    """Return where a row stands: the limit first, a routine's conditions together."""
    return row.routine != LIMIT, row.routine, SHOWN.index(row.condition)


if __name__ == "__main__":
    sys.exit(main())
