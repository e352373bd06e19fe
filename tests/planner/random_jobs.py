"""Small random tasks, and the ways in which the same task can be written."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.planner.drawings import dxf_text as dxf
from tests.planner.examples import EXAMPLE

Vertex = tuple[float, float, float]  # x, y, um, and the bulge of the edge after it
PLACES = 4  # decimals of coordinates, um


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomPart:
    """A part as it is drawn: closed polylines and round holes, um."""

    name: str
    chains: tuple[tuple[Vertex, ...], ...]
    holes: tuple[tuple[float, float, float], ...]  # x, y, radius
    thickness_um: float
    reflectance: float
    start: tuple[float, float, float]  # x, y, um, and theta, degrees
    sigma_xy_um: float
    sigma_theta_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A task: parts on the stage, and a look at each."""

    parts: tuple[RandomPart, ...]
    views_um: tuple[tuple[float, float], ...]  # of the looks, one a part
    cell: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """How a task is written; none of it changes what it means."""

    unit: str = "um"
    halves: bool = False  # circles as two arcs
    first: int = 0  # the vertex that a polyline begins with
    reverse: bool = False
    block: tuple[float, float, float] | None = None  # base x, y, um; turned by degrees
    quarters: int = 0  # by which the world and the camera are turned
    names: Mapping[str, str] = field(default_factory=dict)

    def called(self, name: str) -> str:
        """Return what a part is called."""
        return self.names.get(name, name)


PLAIN = Form()
FORMS: Mapping[str, Form] = {
    "mm": Form(unit="mm"),
    "inches": Form(unit="inch"),
    "circles as two arcs": Form(halves=True),
    "another first vertex": Form(first=2),
    "reversed": Form(reverse=True),
    "in a block": Form(block=(37.0, -21.0, 33.0)),
    "in a block, in mm": Form(block=(-5.5, 12.25, -140.0), unit="mm", first=1),
    "renamed": Form(names={"first": "zeta", "second": "alpha"}),
    "turned by 90 degrees": Form(quarters=1),
    "turned by 180 degrees": Form(quarters=2),
}
_UNIT_UM = {"um": 1.0, "mm": 1e3, "inch": 25_400.0}


def random_job(rng: np.random.Generator) -> Job:
    """Return a task of one or two parts."""
    count = int(rng.integers(1, 3))
    names = ("first", "second")[:count]
    places = [(-80.0, 20.0), (90.0, -10.0)]
    parts = tuple(_part(rng, name, at) for name, at in zip(names, places, strict=False))
    return Job(
        parts=parts,
        views_um=tuple(_pair(rng, 20) for _ in parts),
        cell={
            "numerical_aperture": round(float(rng.uniform(0.2, 0.6)), 3),
            "wavelength_um": round(float(rng.uniform(0.4, 0.7)), 3),
            "repeatability_um": round(float(rng.uniform(0.1, 2)), 3),
            "reflectance": round(float(rng.uniform(0.02, 0.12)), 3),
        },
    )


def _part(rng: np.random.Generator, name: str, at: tuple[float, float]) -> RandomPart:
    chains, holes = (_blob, _toothed, _bracket)[int(rng.integers(3))](rng)
    dx, dy = _pair(rng, 15)
    return RandomPart(
        name=name,
        chains=(chains,),
        holes=holes,
        thickness_um=round(float(rng.uniform(5, 120)), 2),
        reflectance=round(float(rng.uniform(0.3, 0.9)), 3),
        start=(at[0] + dx, at[1] + dy, round(float(rng.uniform(-180, 180)), 1)),
        sigma_xy_um=round(float(rng.uniform(0.5, 8)), 2),
        sigma_theta_deg=round(float(rng.choice([0.0, 0.3, 2.0])), 1),
    )


def _pair(rng: np.random.Generator, most: float) -> tuple[float, float]:
    x, y = rng.uniform(-most, most, 2)
    return round(float(x), 1), round(float(y), 1)


Shape = tuple[tuple[Vertex, ...], tuple[tuple[float, float, float], ...]]


def _blob(rng: np.random.Generator) -> Shape:
    """Return a star-shaped polygon, some edges bent, with or without a hole."""
    count = int(rng.integers(3, 9))
    angles = (np.arange(count) + rng.uniform(0, 0.5, count)) * math.tau / count
    radii = rng.uniform(25, 45, count)
    bulges = np.where(rng.random(count) < 0.3, rng.uniform(0.05, 0.2, count), 0.0)
    chain = tuple(
        (_cut(r * math.cos(a)), _cut(r * math.sin(a)), round(float(b), 3))
        for r, a, b in zip(radii, angles, bulges, strict=True)
    )
    holes = ((_cut(rng.uniform(-1, 1)), _cut(rng.uniform(-1, 1)), 3.5),)
    return chain, holes if count > 4 and rng.random() < 0.6 else ()


def _toothed(rng: np.random.Generator) -> Shape:
    """Return a toothed wheel with a bore."""
    count = int(rng.integers(6, 20))
    tip, root = 45.0, float(rng.uniform(36, 42))
    chain = tuple(
        (_cut(r * math.cos(a)), _cut(r * math.sin(a)), 0.0)
        for k in range(count)
        for share, r in ((0.0, root), (0.25, root), (0.4, tip), (0.85, tip))
        for a in [(k + share) * math.tau / count]
    )
    return chain, ((0.0, 0.0, _cut(rng.uniform(8, 25))),)


def _bracket(rng: np.random.Generator) -> Shape:
    """Return an L with round corners at its ends and two equal holes."""
    w, h = (float(round(v, 4)) for v in rng.uniform(30, 45, 2))
    t = float(round(float(rng.uniform(12, 18)), 4))
    bend = math.sqrt(2) - 1  # a quarter circle
    chain = (
        (-w, -h, 0.0), (w - 3, -h, bend), (w, 3 - h, 0.0), (w, t - h, 0.0),
        (t - w, t - h, 0.0), (t - w, h, 0.0), (-w, h, 0.0),
    )  # fmt: skip
    r = 3.0005
    holes = ((_cut(t / 2 - w), _cut(h - 10), r), (_cut(t / 2 - w), _cut(h - 25), r))
    return tuple((_cut(x), _cut(y), b) for x, y, b in chain), holes


def _cut(value: float) -> float:
    return round(float(value), PLACES) + 0.0


def write_job(job: Job, form: Form, folder: Path) -> Path:
    """Return the task file of a job written in one form."""
    (folder / "parts").mkdir(parents=True)
    for part in job.parts:
        text = _drawing(part, form)
        (folder / "parts" / f"{part.name}.dxf").write_text(text, encoding="ascii")
    for name, data in (("task", _task(job, form)), ("workcell", _cell(job, form))):
        text = yaml.safe_dump(data, sort_keys=False)
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    fingers = EXAMPLE / "parts" / "tweezer_fingers.dxf"
    (folder / "parts" / fingers.name).write_bytes(fingers.read_bytes())
    return folder / "task.yaml"


def _drawing(part: RandomPart, form: Form) -> str:
    """Return a part's drawing."""
    scale = 1 / _UNIT_UM[form.unit]
    bx, by, degrees = form.block or (0.0, 0.0, 0.0)
    back = complex(math.cos(math.radians(degrees)), -math.sin(math.radians(degrees)))

    def move(x: float, y: float) -> tuple[float, float]:
        """Return a point where it is drawn: the block's placing undone."""
        z = (complex(x, y) * back + complex(bx, by)) * scale
        return z.real, z.imag

    layer = "0" if form.block else "A"
    drawn: list[dxf.Tags] = []
    for chain in part.chains:
        rows = [(*move(x, y), bulge) for x, y, bulge in _ordered(chain, form)]
        drawn.append(
            [(c, layer) if c == 8 else (c, v) for c, v in dxf.lwpolyline(rows)]
        )
    for x, y, radius in part.holes:
        drawn += _hole(move(x, y), radius * scale, layer, form)
    if not form.block:
        return dxf.dxf(*drawn, units=0)
    base = (bx * scale, by * scale)
    placed = dxf.insert("PART", (0, 0), (50, repr(degrees)))
    return dxf.dxf(placed, blocks=[("PART", base, drawn)], units=0)


def _hole(
    at: tuple[float, float], radius: float, layer: str, form: Form
) -> list[dxf.Tags]:
    if not form.halves:
        return [dxf.circle(at, radius, layer=layer)]
    return [dxf.arc(at, radius, 20, 200), dxf.arc(at, radius, 200, 20)]


def _ordered(chain: Sequence[Vertex], form: Form) -> list[Vertex]:
    """Return the vertices in the form's order; a bulge belongs to the edge after."""
    rows = list(chain)
    if form.reverse:
        bulges = [row[2] for row in rows]
        rows = [
            (x, y, -bulges[k - 1]) for k, (x, y, _) in reversed(list(enumerate(rows)))
        ]
    first = form.first % len(rows)
    return rows[first:] + rows[:first]


def turned(x: float, y: float, quarters: int) -> tuple[float, float]:
    """Return a point turned about the origin by quarter turns."""
    for _ in range(quarters % 4):
        x, y = -y, x
    return x + 0.0, y + 0.0


def _task(job: Job, form: Form) -> dict[str, Any]:
    parts: dict[str, Any] = {}
    start: dict[str, Any] = {"stage": {"x_um": 0, "y_um": 0, "z_um": 0, "theta_deg": 0}}
    steps: list[dict[str, Any]] = []
    for part, view in zip(job.parts, job.views_um, strict=True):
        name = form.called(part.name)
        file = {"file": f"parts/{part.name}.dxf", "units": form.unit, "layers": ["A"]}
        parts[name] = {
            "drawing": file,
            "thickness_um": part.thickness_um,
            "reflectance": part.reflectance,
        }
        x, y = turned(*part.start[:2], form.quarters)
        start[name] = {
            "on": "stage", "x_um": x, "y_um": y,
            "theta_deg": part.start[2] + 90 * form.quarters,
            "sigma_xy_um": part.sigma_xy_um, "sigma_theta_deg": part.sigma_theta_deg,
        }  # fmt: skip
        steps.append({
            "id": f"see_{part.name}", "do": "locate", "target": name,
            "view_um": list(turned(*view, form.quarters)),
        })  # fmt: skip
    return {
        "microplan": 1, "name": "job", "workcell": "workcell.yaml", "seed": 3,
        "parts": parts, "start": start, "steps": steps,
    }  # fmt: skip


def _cell(job: Job, form: Form) -> dict[str, Any]:
    """Return the example's workcell with the job's numbers, turned with the world."""
    text = (EXAMPLE / "workcell.yaml").read_text(encoding="utf-8")
    data: dict[str, Any] = yaml.safe_load(text)
    optics, stage = data["optics"], data["axes"]["stage"]
    optics["numerical_aperture"] = job.cell["numerical_aperture"]
    optics["wavelength_um"] = job.cell["wavelength_um"]
    optics["focus"]["repeatability_um"] = job.cell["repeatability_um"]
    stage["reflectance"] = job.cell["reflectance"]
    stage["limits"] |= {"x_um": [-3000, 4000], "y_um": [-2000, 5000]}
    stage["theta_axis_um"] = list(turned(30.0, -70.0, form.quarters))
    for axes in data["axes"].values():
        limits = axes["limits"]
        for _ in range(form.quarters % 4):
            (a, b), (c, d) = limits["x_um"], limits["y_um"]
            limits["x_um"], limits["y_um"] = [-d, -c], [a, b]
    if form.quarters % 2:
        for key in ("sensor_um", "pixels"):
            data["camera"][key].reverse()
    return data
