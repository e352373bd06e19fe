"""A plan folder read for an export: plan, outlines, poses, pictures."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np

from microplan.optics.outline.outline import Arc, Edge, Outline, Ring, Segment
from microplan.planner.diff.diffing import MOST_BYTES, DiffError, plan_file, read_plan
from microplan.planner.source.diagnostics import CallError
from microplan.planner.store.pictures import Picture, picture_sha256
from microplan.schemas.codec import CodecError, from_data
from microplan.schemas.files.evidence import LookScene, Scenes
from microplan.schemas.files.world import World, WorldRing
from microplan.schemas.page.page import png_size
from microplan.schemas.plan import Look, Plan, Step

T = TypeVar("T")

_MOST_PX = 1 << 26  # of a picture: an 8192 x 8192 sensor


class ExportError(CallError):
    """Why nothing was exported; carries the code of its finding and the file."""


def unfit(message: str, file: Path, hint: str = "") -> ExportError:
    """Return the error for a file of a plan folder that is missing or does not fit."""
    return ExportError("MP721", message, file, hint)


@dataclass(frozen=True, slots=True, kw_only=True)
class Viewed:
    """One look with its step and its scene."""

    step: Step
    look: Look
    scene: LookScene


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedPlan:
    """A plan, with what else its folder holds of the looks that are exported."""

    path: Path
    plan: Plan
    world: World
    looks: tuple[Viewed, ...]  # in the plan's order
    outlines: Mapping[str, Outline]  # of parts, posts and fingers, by name

    def picture(self, look: Look) -> Picture:
        """Return a look's reference image, (rows, columns) of 8 bit.

        Raises
        ------
        ExportError
            MP721 if it is not there, or is not the one that the plan is of.
        """
        file = self.path / look.scene.image
        need = self.plan.requirements
        size = (need.width_px, need.height_px)
        if "\0" in look.scene.image:
            raise unfit(f"{file} is no name of a file", file)
        if not file.resolve().is_relative_to(self.path.resolve()):
            raise unfit(f"{file} is outside of the plan folder", file)
        data = _read(file)
        try:
            found = png_size(data)
        except ValueError:
            raise unfit(f"{file} is no PNG file", file) from None
        if found != size or size[0] * size[1] > _MOST_PX:
            raise unfit(
                f"{file} has {found[0]} x {found[1]} pixels, the plan's camera "
                f"{size[0]} x {size[1]}",
                file,
            )
        pixels: Any = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        if pixels is None or pixels.dtype != np.uint8 or pixels.ndim != 2:
            raise unfit(f"{file} is no grey picture of 8 bit", file)
        if picture_sha256(pixels) != look.scene.image_sha256:
            raise unfit(f"{file} is not the image that the plan is of", file)
        grey: Picture = pixels
        return grey


def read_folder(path: Path, wanted: Sequence[str]) -> ExportedPlan:
    """Return a plan folder with the looks that are wanted, all if none is named.

    Parameters
    ----------
    path : Path
        The folder, or the plan.json in it.
    wanted : sequence of str
        Ids of looks, in any order.

    Raises
    ------
    ExportError
        MP704 if the plan cannot be read, MP720 if it has no look or not those that are
        wanted, MP721 if another file is missing or does not fit.
    """
    try:
        plan = read_plan(path)
    except DiffError as error:
        raise ExportError(error.code, str(error), Path(error.file)) from error
    file = plan_file(path)
    looks = _chosen(plan, wanted, file)
    world = _json(file.with_name("world.json"), World)
    scenes = _json(file.with_name("scenes.json"), Scenes)
    return ExportedPlan(
        path=file.parent,
        plan=plan,
        world=world,
        looks=tuple(_viewed(looks, scenes, file.with_name("scenes.json"))),
        outlines=_outlines(world, file.with_name("world.json")),
    )


def _chosen(plan: Plan, wanted: Sequence[str], file: Path) -> list[tuple[Step, Look]]:
    """Return the looks that are wanted, in the plan's order."""
    looks = [(step, look) for step in plan.steps for look in step.looks]
    if not looks:
        why = f": {plan.reasons[0].message}" if plan.reasons else ""
        why = why or (": it is a sketch" if plan.is_sketch else "")
        raise ExportError("MP720", f"plan {plan.name!r} has no look{why}", file)
    known = [look.id for _, look in looks]
    for name in wanted:
        if name not in known:
            raise ExportError(
                "MP720",
                f"plan {plan.name!r} has no look {name!r}",
                file,
                f"it has {', '.join(known)}",
            )
    return [each for each in looks if not wanted or each[1].id in wanted]


def _viewed(
    looks: Sequence[tuple[Step, Look]], scenes: Scenes, file: Path
) -> Iterator[Viewed]:
    """Yield the looks with their scenes."""
    by_look = {scene.look: scene for scene in scenes.looks}
    for step, look in looks:
        if not min(look.view.um_per_px, look.view.magnification) > 0:
            raise unfit(f"look {look.id!r} has no scale", file)
        if look.id not in by_look:
            raise unfit(f"{file} says nothing of look {look.id!r}", file)
        yield Viewed(step=step, look=look, scene=by_look[look.id])


def _outlines(world: World, file: Path) -> dict[str, Outline]:
    """Return the outline of every body by its name in a scene."""
    try:
        return {
            name: Outline(rings=tuple(_ring(ring) for ring in outline.rings))
            for name, outline in world.outlines.items()
        }
    except ValueError as error:
        raise unfit(f"{file}: {error}", file) from error


def _ring(ring: WorldRing) -> Ring:
    return Ring(edges=tuple(map(_edge, ring.edges)), layer=ring.layer)


def _edge(numbers: tuple[float, ...]) -> Edge:
    """Return an edge; ValueError if it has neither four nor five numbers."""
    if len(numbers) == 4:
        return Segment(start=numbers[:2], end=numbers[2:])
    if len(numbers) != 5:
        raise ValueError(f"an edge has four or five numbers, got {len(numbers)}")
    x, y, radius, start, sweep = numbers
    return Arc(center=(x, y), radius_um=radius, start_rad=start, sweep_rad=sweep)


def _json(file: Path, kind: type[T]) -> T:
    """Return what a JSON file of the plan folder holds."""
    try:
        return from_data(kind, json.loads(_read(file).decode("utf-8")))
    except (ValueError, RecursionError) as error:  # CodecError is a ValueError
        if isinstance(error, CodecError):
            message = f"{file} does not fit: {error}"
        else:
            message = f"{file} is not JSON: {error}"
        raise unfit(message, file) from error


def _read(file: Path) -> bytes:
    """Return a file's bytes, up to a size."""
    try:
        if file.exists() and not file.is_file():
            raise unfit(f"{file} is no regular file", file)
        with file.open("rb") as stream:
            data = stream.read(MOST_BYTES + 1)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise unfit(
            f"cannot read {file}: {why}", file, "compile the task again"
        ) from error
    if len(data) > MOST_BYTES:
        raise unfit(f"{file} is larger than {MOST_BYTES} bytes", file)
    return data
