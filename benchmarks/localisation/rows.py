"""What each routine does alone at one scene and condition, through focus.

From where it would start: what searches from the nominal place, what needs a start from
one as good as a coarse routine gives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from benchmarks.localisation.points import HEIGHTS_UM
from benchmarks.localisation.scenes import ACROSS, SCENES, Drawn, disturbed, draws
from benchmarks.localisation.trials import (
    SEED,
    TOLERANCE_RAD,
    TOLERANCE_UM,
    WRONG,
    errors,
    guess,
    limit_squared,
    near,
    timed,
)
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.templates import along
from microplan.featuresel.routines.contract import Artifact, Failure, Guess
from microplan.featuresel.routines.registry import load
from microplan.featuresel.trials.trials import start

FEWEST = 30  # trials a point of the slowest routine
WORK = 1500.0  # by the cost model, that a routine may take for all trials of a point
LIMIT = "limit"  # what the limit's row is called


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What one routine did at one scene and condition, by height."""

    scene: str
    routine: str
    condition: str
    trials: int  # all heights; fewer for what takes long
    right: int  # answers within two tolerances
    silent: int  # other answers
    ratio_x: tuple[float, ...]  # rms of right answers over the limit, of edges across
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


def rows(place: tuple[str, str], names: Sequence[str], trials: int) -> list[Row]:
    """Return the limit, and a row for every routine that looks for a scene's kind."""
    cv2.setNumThreads(1)
    scene, condition = place
    case = disturbed(SCENES[scene](), condition)
    render = nominal_render(case)
    ready = {name: load(name).prepare(render, case.target) for name in names}
    seen: dict[str, list[_Seen]] = {name: [] for name in ready}
    known = []
    for z_um in HEIGHTS_UM:
        shown = list(draws(case, z_um, trials, SEED))
        known.append(_limits(case, shown))
        for name, artifact in ready.items():
            if isinstance(artifact, Artifact):
                some = shown[: affordable(name, artifact, shown[0], trials)]
                seen[name].append(_measured(case, name, artifact, some))
    return [
        _limit_row(place, known),
        *(_row(place, name, made, seen[name], known) for name, made in ready.items()),
    ]


def affordable(name: str, artifact: Artifact, shown: Drawn, trials: int) -> int:
    """Return how many trials a routine gets at each height: fewer if it is slow.

    By its cost model, so that the same are measured on any machine.
    """
    work = load(name).cost(artifact, shown.image.size)
    return min(trials, max(FEWEST, int(WORK / work)))


def _limits(case: LookCase, shown: Sequence[Drawn]) -> tuple[float, ...]:
    """Return the limit of x, or across an edge, and of theta, as in the units."""
    x, y, theta = limit_squared(case, [d.setting for d in shown])
    across = y if case.target.kind in ACROSS else x
    return math.sqrt(across), math.sqrt(theta)


def begin(case: LookCase, name: str, drawn: Drawn, rng: np.random.Generator) -> Guess:
    """Return where a routine starts: the nominal place, or as near as it needs."""
    needs = load(name).requires
    if not needs:
        return start(case)
    if "z" in needs:
        return near(case, drawn, rng)
    return guess(case, drawn, rng, told=True)


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
        found, spent_s = timed(partial(routine.measure, drawn.image, artifact, at))
        taken.append(1e3 * spent_s)
        if isinstance(found, Failure):
            codes.append(found.code)
            continue
        dx, dy, turn = errors(case, drawn, found)
        placed, turned = "xy" in routine.provides, not math.isnan(turn)
        off = along((dx, dy), found.axis_rad)
        far = placed and math.hypot(*off) > WRONG * TOLERANCE_UM
        if far or (turned and abs(turn) > WRONG * TOLERANCE_RAD):
            silent += 1
            continue
        right += 1
        x += [_across(off, found.axis_rad)] if placed else []
        theta += [turn] if turned and "theta" in routine.provides else []
    return _Seen(
        trials=len(shown), silent=silent, x=tuple(x), theta=tuple(theta),
        right=right, ms=tuple(taken), codes=tuple(codes),
    )  # fmt: skip


def _across(off_um: tuple[float, float], axis_rad: float | None) -> float:
    """Return the error in x, or its size along the one direction that is known."""
    return off_um[0] if axis_rad is None else math.hypot(*off_um)


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
        ratio_theta=tuple(_rms(s.theta) / k[1] for s, k in pairs),
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
        ratio_theta=tuple(1e3 * math.degrees(k[1]) for k in known),
        ms=math.nan,
        refused="",
        codes=(),
    )


def _rms(values: Sequence[float]) -> float:
    """Return the root mean square, nan of nothing."""
    return math.sqrt(float(np.mean(np.square(values)))) if values else math.nan
