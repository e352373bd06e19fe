"""The gear example with keyed bores and posts, compiled at preset `fast`.

`fit.keyed_feasible` is how many of PAIRS keyed pairs with 3 to 4 um of room give a
feasible plan, `fit.keyed_seated` of how many of those one run on the simulated cell
ends with the gear truly on its post, `fit.keyed_least_probability` the least P.
A pair takes minutes; runs have the `solid` camera.
"""

from __future__ import annotations

import math
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.compiling.outline_shapes import (
    box,
    cross,
    d_shape,
    keyed,
    slot,
    spline,
    star,
)
from benchmarks.executing.runs import perform
from benchmarks.figures import Benchmark, Figure, Options
from microplan.optics.outline.outline import Arc, Edge, Outline
from microplan.planner.cli.main import main
from microplan.planner.task.regions.features import dominant_circle
from microplan.schemas.plan import Plan, parse_plan

EXAMPLE = Path(__file__).parents[2] / "examples" / "gear_on_shaft"
BORE_UM = 25.0
PAIRS, SEED = 24, 3
NAMES = ("fit.keyed_feasible", "fit.keyed_seated", "fit.keyed_least_probability")
# What the example has, and what a bore that is no circle has in its place.
REDONE = (
    ("notch: {kind: notch, layer: BORE}", ""),
    # what is tried is what the workcell and the start say, not more
    ("focus_sigma_um: 4", "focus_sigma_um: 1"),
    ("magnification_sigma: 0.005", "magnification_sigma: 0.002"),
    ("pose_sigma_theta_deg: 5", "pose_sigma_theta_deg: 1"),
    ("teeth: {kind: teeth, layer: OUTLINE, count: 18}", ""),
    (
        "theta: any, sigma_xy_um: 30",
        "theta_deg: 10, sigma_theta_deg: 2, sigma_xy_um: 30}",
    ),
)


def keyed_pairs(count: int, seed: int) -> Iterator[tuple[str, Outline, Outline]]:
    """Yield names, bores and posts with 3 to 4 um of room, by kinds in turn."""
    rng = np.random.default_rng(seed)
    kinds = ("D", "key", "keyway", "rectangle", "slot", "cross", "spline", "star")
    for index in range(count):
        kind, gap = kinds[index % len(kinds)], float(rng.uniform(3.0, 4.0))
        yield kind, *_pair(kind, gap, rng)


def _pair(kind: str, gap: float, rng: np.random.Generator) -> tuple[Outline, Outline]:
    """Return a bore and a post with a gap all round."""
    r, a = BORE_UM, float(rng.uniform(0.4, 0.7))
    s = r - gap
    if kind == "D":
        return d_shape(r, a * r + gap), d_shape(s, a * r)
    if kind == "key":
        return keyed(r, r + 6, 8 + 2 * gap), keyed(s, s + 6, 8)
    if kind == "keyway":
        return keyed(r, r - 6, 8), keyed(s, s - 6, 8 + 2 * gap)
    if kind == "rectangle":
        return box(r, a * r + gap), box(s, a * r)
    if kind == "slot":
        return slot(10, a * 20 + gap), slot(10, a * 20)
    if kind == "cross":
        return cross(r, 6 + gap), cross(s, 6)
    if kind == "spline":
        return spline(6, r, 0.8 * r, gap), spline(6, s, 0.8 * r - gap, 0.0)
    radii = s * np.array([1.0, 0.8, 0.95, 0.75, 0.9, 0.85])
    return star((radii + 1.3 * gap).tolist()), star(radii.tolist())


def write_task(folder: Path, bore: Outline, post: Outline) -> Path:
    """Return the task file of the example with another bore and post."""
    shutil.copytree(EXAMPLE, folder)
    redraw(folder / "parts" / "gear18.dxf", "BORE", bore)
    redraw(folder / "parts" / "shaft_plate.dxf", "POST", post)
    file = folder / "task.yaml"
    text = file.read_text(encoding="utf-8")
    bored = ("bore:  {kind: circle", "bore: {kind: outline, layer: BORE}")
    for old, new in REDONE if dominant_circle(bore.rings[0]) else (*REDONE, bored):
        assert old in text
        text = re.sub(re.escape(old) + ".*", new, text)
    file.write_text(text, encoding="utf-8")
    return file


def redraw(file: Path, layer: str, outline: Outline) -> None:
    """Replace all entities of a layer of a plain drawing."""
    lines = file.read_text(encoding="utf-8").splitlines()
    start = lines.index("ENTITIES") + 1
    end = lines.index("ENDSEC", start) - 1
    pairs = list(zip(lines[start:end:2], lines[start + 1 : end : 2], strict=True))
    kept: list[tuple[str, str]] = []
    for entity in _entities(pairs):
        if ("8", layer) not in [(code.strip(), value) for code, value in entity]:
            kept += entity
    for edge in outline.rings[0].edges:
        kept += _entity(layer, edge)
    body = [text for pair in kept for text in pair]
    file.write_text("\n".join([*lines[:start], *body, *lines[end:]]) + "\n", "utf-8")


def _entities(pairs: list[tuple[str, str]]) -> Iterator[list[tuple[str, str]]]:
    """Yield the pairs of each entity."""
    found: list[tuple[str, str]] = []
    for code, value in pairs:
        if code.strip() == "0" and found:
            yield found
            found = []
        found.append((code, value))
    if found:
        yield found


def _entity(layer: str, edge: Edge) -> list[tuple[str, str]]:
    """Return a line or an arc as group codes."""
    if not isinstance(edge, Arc):
        values = zip(("10", "20", "11", "21"), (*edge.start, *edge.end), strict=True)
        return [("0", "LINE"), ("8", layer), *((c, repr(float(v))) for c, v in values)]
    low, high = sorted((edge.start_rad, edge.start_rad + edge.sweep_rad))
    x, y = edge.center
    numbers = (x, y, edge.radius_um, math.degrees(low) % 360, math.degrees(high) % 360)
    codes = zip(("10", "20", "40", "50", "51"), numbers, strict=True)
    return [("0", "ARC"), ("8", layer), *((c, repr(float(v))) for c, v in codes)]


def compiled(count: int, seed: int, folder: Path, jobs: int) -> list[tuple[Plan, bool]]:
    """Return the plans of keyed pairs, and whether a run of each seats the gear.

    `jobs` pairs at a time.
    """
    pairs = enumerate(keyed_pairs(count, seed))
    # spawned, as a process forked from one with threads may hang
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        return list(pool.map(partial(_compiled, folder), pairs))


def _compiled(
    folder: Path, pair: tuple[int, tuple[str, Outline, Outline]]
) -> tuple[Plan, bool]:
    """Return the plan of one pair, by its number, and whether a run seats the gear."""
    index, (_, bore, post) = pair
    task = write_task(folder / f"{index}", bore, post)
    out = folder / f"{index}.plan"
    options = ["--preset", "fast", "--no-cache", "--jobs", "1", "-o", str(out)]
    main(["compile", str(task), *options])
    plan = parse_plan((out / "plan.json").read_text("utf-8"))
    feasible, runs = plan.status == "feasible", folder / f"{index}.runs"
    return plan, feasible and perform(out, runs, index, "solid").seated


def measure(options: Options) -> Iterable[Figure]:
    """Yield the figures of the keyed pairs."""
    with tempfile.TemporaryDirectory() as name:
        plans = compiled(PAIRS, SEED, Path(name), options.jobs)
    chances = [p.success_probability for p, _ in plans if p.status == "feasible"]
    values = (len(chances), sum(seated for _, seated in plans), min(chances, default=0))
    for name, value in zip(NAMES, values, strict=True):
        yield Figure(name=name, value=float(value), unit="1")


BENCHMARK = Benchmark(names=NAMES, measure=measure)
