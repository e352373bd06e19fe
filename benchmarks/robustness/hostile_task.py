"""The small task that hostile files are put into: one part, one look at it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.example import TASK
from tests.planner.drawings.dxf_text import circle, dxf

DRAWING = "parts/part.dxf"
ALLOWED = frozenset((2,))  # exit statuses where nothing else is said
FINE = frozenset((0, 1, 2))  # of what may well be a part

_TEXT = """\
microplan: 1
name: hostile
workcell: workcell.yaml
seed: 1
parts:
  part:
    drawing: {{file: {file}, units: um, layers: [{layer}]}}
    thickness_um: 10
    reflectance: 0.8
start:
  stage: {{x_um: 0, y_um: 0, z_um: 0, theta_deg: 0}}
  part: {{on: stage, x_um: 0, y_um: 0, theta_deg: 0, sigma_xy_um: 2}}
steps:
  - {{id: look, do: locate, target: part, view_um: [0, 0]}}
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Something that a folder of inputs may hold, and what may be said of it."""

    name: str
    put: Callable[[Path], None]  # changes a folder that `lay_out` made
    statuses: frozenset[int] = ALLOWED


def task_text(file: str = DRAWING, layer: str = "A") -> str:
    """Return the task whose part is drawn on a layer of a file."""
    return _TEXT.format(file=file, layer=layer)


def lay_out(folder: Path) -> Path:
    """Return the task file of a new folder in which all is in order."""
    example = TASK.parent
    parts = folder / "parts"
    parts.mkdir(parents=True)
    shutil.copy(example / "workcell.yaml", folder)
    shutil.copy(example / "parts" / "tweezer_fingers.dxf", parts)
    (folder / DRAWING).write_text(dxf(circle((0, 0), 50)), encoding="utf-8")
    file = folder / "task.yaml"
    file.write_text(task_text(), encoding="utf-8")
    return file


def drawing(
    name: str, content: str | bytes | Callable[[], str | bytes], *,
    file: str = DRAWING, layer: str = "A", statuses: frozenset[int] = ALLOWED,
) -> Case:  # fmt: skip
    """Return the case of a drawing with this content, made when it is needed."""

    def put(folder: Path) -> None:
        made = content() if callable(content) else content
        data = made.encode("utf-8", "surrogatepass") if isinstance(made, str) else made
        (folder / file).write_bytes(data)
        (folder / "task.yaml").write_text(task_text(file, layer), encoding="utf-8")

    return Case(name=name, put=put, statuses=statuses)


def task(
    name: str, content: str | bytes | Callable[[], str | bytes], *,
    statuses: frozenset[int] = ALLOWED,
) -> Case:  # fmt: skip
    """Return the case of a task file with this content."""

    def put(folder: Path) -> None:
        made = content() if callable(content) else content
        data = made.encode("utf-8", "surrogatepass") if isinstance(made, str) else made
        (folder / "task.yaml").write_bytes(data)

    return Case(name=name, put=put, statuses=statuses)
