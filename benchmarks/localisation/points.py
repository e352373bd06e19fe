"""All points of the benchmark of localisation, and tables of what was found there."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from benchmarks.localisation.depth import WAYS as PAIRS
from benchmarks.localisation.scenes import CONDITIONS, FITTED
from benchmarks.localisation.trials import AXES, SAME, Part, Unit

HEIGHTS_UM = (0.0, 5.0, 10.0, 25.0)
DEPTHS_UM = (0.0, 0.15, 5.0, 10.0)  # .15: of a second pair about what the first said
TRIALS = 1500
PART = 250  # trials of a unit: seconds to minutes
SAME_LAW = "likelihood" + SAME
WAYS = ("likelihood", SAME_LAW, "one_step", *PAIRS)
_STEPPED = ("plain", "all")
_SLOW = "gear_close"
# where blur laws differ most
_LAWS = (("fingers", "plain"), (_SLOW, "fingers"), (_SLOW, "all"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """What was found at one scene, condition and height, all parts together."""

    way: str
    scene: str
    condition: str
    z_um: float
    trials: int
    failed: int
    silent: int
    bias: tuple[float, ...]  # of right answers; x, y um and theta rad, or z um alone
    rms: tuple[float, ...]
    limit: tuple[float, ...]
    code: str  # the commonest of failures
    cpu_s: tuple[float, float, float]  # drawing, measuring, the limit

    @property
    def ratios(self) -> tuple[float, ...]:
        """Return rms over limit, nan where nothing was right."""
        return tuple(r / m for r, m in zip(self.rms, self.limit, strict=True))


def units(trials: int) -> list[Unit]:
    """Return all that is measured, the scene that takes longest last."""
    places = [("one_step", "gear", c, z) for c in _STEPPED for z in HEIGHTS_UM]
    places += [(way, "gear", "plain", z) for way in PAIRS for z in DEPTHS_UM]
    places += [
        ("likelihood", scene, condition, z)
        for scene in sorted(FITTED, key=lambda scene: scene == _SLOW)
        for condition in CONDITIONS
        if not (scene == "fingers" and condition == "fingers")
        for z in HEIGHTS_UM
    ]
    places += [(SAME_LAW, *place, z) for place in _LAWS for z in HEIGHTS_UM]
    return [
        Unit(
            way=way, scene=scene, condition=condition, z_um=z, part=part,
            trials=min(PART, trials - first),
        )
        for way, scene, condition, z in places
        for part, first in enumerate(range(0, trials, PART))
    ]  # fmt: skip


def points(done: Sequence[tuple[Unit, Part]]) -> list[Point]:
    """Return the parts of each point put together, sorted as the units are."""
    groups: dict[tuple[str, str, str, float], list[Part]] = {}
    for unit, part in sorted(done, key=lambda pair: _rank(pair[0])):
        place = unit.way, unit.scene, unit.condition, unit.z_um
        groups.setdefault(place, []).append(part)
    return [_point(place, parts) for place, parts in groups.items()]


def _rank(unit: Unit) -> tuple[int, int, int, float, int]:
    """Return where a unit stands in tables."""
    return (
        WAYS.index(unit.way),
        list(FITTED).index(unit.scene),
        CONDITIONS.index(unit.condition),
        unit.z_um,
        unit.part,
    )


def _point(place: tuple[str, str, str, float], parts: Sequence[Part]) -> Point:
    """Return one point."""
    trials = sum(p.trials for p in parts)
    failed, silent = sum(p.failed for p in parts), sum(p.silent for p in parts)
    right = trials - failed - silent or math.nan
    codes = Counter(code for p in parts for code in p.codes)

    def mean(sums: Sequence[tuple[float, ...]], count: float) -> tuple[float, ...]:
        return tuple(sum(each) / count for each in zip(*sums, strict=True))

    limits = [tuple(v * p.trials for v in p.limit_squared) for p in parts]
    return Point(
        way=place[0],
        scene=place[1],
        condition=place[2],
        z_um=place[3],
        trials=trials,
        failed=failed,
        silent=silent,
        bias=mean([p.sums for p in parts], right),
        rms=tuple(math.sqrt(v) for v in mean([p.squares for p in parts], right)),
        limit=tuple(math.sqrt(v) for v in mean(limits, trials)),
        code=min(codes, key=lambda c: (-codes[c], c), default=""),
        cpu_s=mean([p.cpu_s for p in parts], 1.0),  # type: ignore[arg-type] # of three
    )


def lines(found: Sequence[Point]) -> Iterator[str]:
    """Yield a table for every way and scene, rms over limit."""
    before = None
    for point in found:
        if (point.way, point.scene) != before:
            before = point.way, point.scene
            axes = AXES[: len(point.rms)] if len(point.rms) > 1 else ("z", "bias um")
            head = [
                "condition",
                "z um",
                *axes,
                "failed aloud",
                "silent",
                "trials",
                "ms",
            ]
            yield f"\n### `{point.way}`, {point.scene}\n"
            yield "| " + " | ".join(head) + " |"
            yield "|" + "---|" * len(head)
        cells = [point.condition, f"{point.z_um:g}", *map(_cell, point.ratios)]
        cells += [_signed(point.bias[0])] if len(point.rms) == 1 else []
        cells += [f"{point.failed} {point.code}".strip(), str(point.silent)]
        cells += [str(point.trials), f"{1e3 * point.cpu_s[1] / point.trials:.3g}"]
        yield "| " + " | ".join(cells) + " |"


def _cell(value: float) -> str:
    """Return two decimals, three digits above 10, nothing of a nan."""
    if math.isnan(value):
        return ""
    return f"{value:.2f}" if value < 10 else f"{value:.3g}"


def _signed(value: float) -> str:
    return "" if math.isnan(value) else f"{value:+.3f}"


def costs(found: Sequence[Point], trials: int) -> Iterator[str]:
    """Yield where CPU time went by way and scene, and what it is for `trials`."""
    yield (
        f"\n| way | scene | drawing s | measuring s | limit s | {trials} trials, min |"
    )
    yield "|---|---|---|---|---|---|"
    total = 0.0
    for way, scene in dict.fromkeys((p.way, p.scene) for p in found):
        mine = [p for p in found if (p.way, p.scene) == (way, scene)]
        spent = [sum(p.cpu_s[k] for p in mine) for k in range(3)]
        whole = sum(_whole_s(p, trials) for p in mine) / 60
        total += whole
        cells = [way, scene, *(f"{s:.0f}" for s in spent), f"{whole:.1f}"]
        yield "| " + " | ".join(cells) + " |"
    yield f"\n{trials} trials a point: {total:.0f} min of CPU time, and preparing"


def _whole_s(point: Point, trials: int) -> float:
    """Return the CPU time of a point of `trials`; the limit is of every unit."""
    had, wanted = (math.ceil(n / PART) for n in (point.trials, trials))
    drawing, measuring, limiting = point.cpu_s
    return (drawing + measuring) * trials / point.trials + limiting * wanted / had
