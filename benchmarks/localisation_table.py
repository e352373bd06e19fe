"""Every routine against the limit: python -m benchmarks.localisation_table.

Each alone, from where it would start: what searches from the nominal place, what needs
a start from one as good as a coarse routine gives. Truth is another blur law than the
one that routines are prepared with; bias counts in the rms.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy is loaded, so that times compare

import cv2  # noqa: E402 - see above
import numpy as np  # noqa: E402

from benchmarks.localisation import (  # noqa: E402
    HEIGHTS_UM,
    OFF_RAD,
    SEED,
    errors,
    guess,
    limits,
    start,
)
from benchmarks.localisation_scenes import (  # noqa: E402
    SCENES,
    Drawn,
    disturbed,
    draws,
)
from benchmarks.timing import cpu_s  # noqa: E402
from featuresel.case import LookCase  # noqa: E402
from featuresel.nominal import nominal_render  # noqa: E402
from featuresel.routines import (  # noqa: E402
    REGISTRY,
    Artifact,
    Failure,
    Guess,
    Measurement,
    load,
)

TRIALS = 100
SHOWN = ("plain", "all")
# what a look may ask of a part of 100 um under 1 um pixels, and that at its rim
TOLERANCE_UM, TOLERANCE_RAD = 0.5, 0.01
WRONG = 2.0  # tolerances, as in the trials
NEAR_PX = 0.3  # what the last answer of a servo is off by, that `one_step` starts from
NEAR_UM = 0.5  # and its focus
_RIM_UM = 50.0  # of the gear: what NEAR_PX there is as an angle and a zoom
_LIMITS = 2  # settings at each height whose limits are averaged
_CELL = "{:.2g}"
LIMIT = "limit"


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What one routine did at one scene and condition, by height."""

    scene: str
    routine: str
    condition: str
    trials: int  # all heights
    right: int  # answers within two tolerances
    silent: int  # other answers
    ratio_x: tuple[float, ...]  # rms of right answers over the limit; nan: none
    ratio_theta: tuple[float, ...]
    ms: float  # median CPU time of one measure; nan if it was not prepared
    refused: str  # why it could not be prepared
    codes: tuple[str, ...]  # of failures


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """What one routine said at one height."""

    trials: int
    silent: int
    x: tuple[float, ...]  # errors of right answers
    theta: tuple[float, ...]
    right: int
    ms: tuple[float, ...]
    codes: tuple[str, ...]  # of failures


def rows(
    place: tuple[str, str], trials: int, names: Sequence[str] = tuple(REGISTRY)
) -> list[Row]:
    """Return the limit, and a row for every routine that looks for a scene's kind."""
    cv2.setNumThreads(1)
    scene, condition = place
    case = disturbed(SCENES[scene](), condition)
    render = nominal_render(case)
    ready = {
        name: load(name).prepare(render, case.target)
        for name in sorted(names)
        if case.target.kind in load(name).KINDS
    }
    seen: dict[str, list[_Seen]] = {name: [] for name in ready}
    known = []
    for z_um in HEIGHTS_UM:
        shown = draws(case, z_um, trials, SEED)
        every = max(1, trials // _LIMITS)
        known.append(limits(case, [d.setting for d in shown[::every]][:_LIMITS]))
        for name, artifact in ready.items():
            if isinstance(artifact, Artifact):
                seen[name].append(_measured(case, name, artifact, shown))
    return [
        _limit_row(place, known),
        *(_row(place, name, made, seen[name], known) for name, made in ready.items()),
    ]


def near(case: LookCase, drawn: Drawn, rng: np.random.Generator) -> Guess:
    """Return what a servo knows before its last cycle: all of it, and nearly right."""
    s = drawn.setting
    off, along = NEAR_PX * math.sqrt(rng.random()), 2 * math.pi * rng.random()
    column, row = case.frame.to_pixel(
        s.zoom * (case.x_um + s.dx_um), s.zoom * (case.y_um + s.dy_um)
    )
    turn = NEAR_PX / case.microscope.px_per_um / _RIM_UM
    zoomed = turn * rng.uniform(-1, 1) if case.spread.magnification_sigma else 0.0
    return Guess(
        column=column + off * math.cos(along),
        row=row + off * math.sin(along),
        theta_rad=case.theta_rad + s.dtheta_rad + turn * rng.uniform(-1, 1),
        z_um=s.dz_um + NEAR_UM * rng.uniform(-1, 1),
        zoom=s.zoom + zoomed,
    )


def begin(case: LookCase, name: str, drawn: Drawn, rng: np.random.Generator) -> Guess:
    """Return where a routine starts: the nominal place, or as near as it needs."""
    needs = load(name).NEEDS
    if not needs:
        return start(case)
    if "z" in needs:
        return near(case, drawn, rng)
    turned = case.theta_rad + drawn.setting.dtheta_rad + OFF_RAD * rng.uniform(-1, 1)
    return replace(guess(case, drawn, rng), theta_rad=turned)


def _measured(
    case: LookCase, name: str, artifact: Artifact, shown: Sequence[Drawn]
) -> _Seen:
    """Return what a routine says of every image of one height."""
    routine, rng = load(name), np.random.default_rng(SEED)
    x: list[float] = []
    theta: list[float] = []
    taken: list[float] = []
    codes: list[str] = []
    right = silent = 0
    for drawn in shown:
        at = begin(case, name, drawn, rng)
        kept: list[Measurement | Failure] = []
        call = partial(routine.measure, drawn.image, artifact, at)
        taken.append(1e3 * cpu_s(lambda: kept.append(call())))  # noqa: B023 - called now
        if isinstance(kept[0], Failure):
            codes.append(kept[0].code)
            continue
        dx, dy, turn = errors(case, drawn, kept[0])
        placed, turned = "xy" in routine.GIVES, not math.isnan(turn)
        far = placed and math.hypot(dx, dy) > WRONG * TOLERANCE_UM
        if far or (turned and abs(turn) > WRONG * TOLERANCE_RAD):
            silent += 1
            continue
        right += 1
        x += [dx] if placed else []
        theta += [turn] if turned and "theta" in routine.GIVES else []
    return _Seen(
        trials=len(shown), silent=silent, x=tuple(x), theta=tuple(theta),
        right=right, ms=tuple(taken), codes=tuple(codes),
    )  # fmt: skip


def _row(
    place: tuple[str, str],
    name: str,
    artifact: Artifact | Failure,
    seen: Sequence[_Seen],
    known: Sequence[tuple[float, ...]],
) -> Row:
    """Return a routine's row from what it said at each height."""
    refused = artifact.code if isinstance(artifact, Failure) else ""
    every = [ms for s in seen for ms in s.ms]
    pairs = list(zip(seen, known, strict=True)) if seen else []
    return Row(
        scene=place[0],
        routine=name,
        condition=place[1],
        trials=sum(s.trials for s in seen),
        right=sum(s.right for s in seen),
        silent=sum(s.silent for s in seen),
        ratio_x=tuple(_rms(s.x) / k[0] for s, k in pairs),
        ratio_theta=tuple(_rms(s.theta) / k[2] for s, k in pairs),
        ms=float(np.median(every)) if every else math.nan,
        refused=refused,
        codes=tuple(code for s in seen for code in s.codes),
    )


def _limit_row(place: tuple[str, str], known: Sequence[tuple[float, ...]]) -> Row:
    """Return the limit itself, nm and mdeg, as the first row."""
    return Row(
        scene=place[0],
        routine=LIMIT,
        condition=place[1],
        trials=0,
        right=0,
        silent=0,
        ratio_x=tuple(1e3 * k[0] for k in known),
        ratio_theta=tuple(1e3 * math.degrees(k[2]) for k in known),
        ms=math.nan,
        refused="",
        codes=(),
    )


def _rms(values: Sequence[float]) -> float:
    """Return the root mean square, nan of nothing."""
    return math.sqrt(float(np.mean(np.square(values)))) if values else math.nan


def lines(scene: str, found: Sequence[Row], trials: int) -> Iterator[str]:
    """Yield a scene's table, in which the limit is 1."""
    heights = [f"{z:g}" for z in HEIGHTS_UM]
    yield f"\n### {scene}, {trials} trials a point\n"
    head = ["routine", "condition", *(f"x {z}" for z in heights)]
    turned = scene != "shaft"
    head += [f"theta {z}" for z in heights] if turned else []
    head += ["right", "silent", "fails mostly as", "ms"]
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


def main(argv: Sequence[str] | None = None) -> int:
    """Print a table per scene."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.localisation_table")
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--scene", choices=list(SCENES), action="append")
    parser.add_argument("--routine", choices=sorted(REGISTRY), action="append")
    call = parser.parse_args(argv)
    places = [(s, c) for s in call.scene or SCENES for c in SHOWN]
    work = partial(rows, trials=call.trials, names=call.routine or tuple(REGISTRY))
    with ProcessPoolExecutor(call.jobs) as pool:
        done: list[Row] = []
        for (scene, condition), some in zip(
            places, pool.map(work, places), strict=True
        ):
            done += some
            if condition == SHOWN[-1]:
                mine = sorted(
                    (row for row in done if row.scene == scene),
                    key=lambda r: (
                        r.routine != LIMIT,
                        r.routine,
                        SHOWN.index(r.condition),
                    ),
                )
                print("\n".join(lines(scene, mine, call.trials)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
