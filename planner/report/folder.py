"""What a plan folder holds, read for a report; what is missing is left out."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from microplan.planner.diff.diffing import plan_file, read_plan
from microplan.planner.diff.pictures import decoded
from microplan.planner.source.diagnostics import Diagnostic
from microplan.planner.store.folder import FINDINGS
from microplan.planner.store.pictures import picture_sha256
from microplan.schemas.codec import CodecError, from_data
from microplan.schemas.files.evidence import FOLDER, LookEvidence
from microplan.schemas.files.world import World
from microplan.schemas.folders import contents_within
from microplan.schemas.page.page import png_size
from microplan.schemas.plan import Look, Plan, SketchedLook

MOST_BYTES = 1 << 24  # of any other file than plan.json

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedPlan:
    """A plan with the other files of its folder."""

    plan: Plan
    sha256: str  # of plan.json
    world: World | None
    evidence: Mapping[str, LookEvidence]  # by the look's id
    pictures: Mapping[str, bytes]  # PNG files by their path in the folder
    foreign: frozenset[str]  # paths of images that are not those that the plan is of
    versions: Mapping[str, str]  # of what made the plan
    findings: tuple[Diagnostic, ...]  # of the compile

    @property
    def looks(self) -> tuple[Look, ...]:
        """Return all looks in order."""
        return tuple(look for step in self.plan.steps for look in step.looks)


def read_folder(path: Path) -> ReportedPlan:
    """Return what a plan folder, or the folder of a plan.json, holds.

    Raises
    ------
    DiffError
        MP704 if there is no plan that can be read.
    """
    plan, file = read_plan(path), plan_file(path)
    folder = file.parent
    looks = [look for step in plan.steps for look in step.looks]
    evidence = {
        look.id: found
        for look in looks
        if (found := _typed(LookEvidence, folder, f"{FOLDER}/{look.id}.json"))
    }
    seen: list[Look | SketchedLook] = [*looks, *plan.sketched]
    names = [look.scene.image for look in seen]
    names += [shown.image for each in evidence.values() for shown in each.shown]
    pictures = dict(_pictures(folder, names))
    foreign = frozenset(_foreign(seen, pictures))
    return ReportedPlan(
        plan=plan,
        sha256=hashlib.sha256(file.read_bytes()).hexdigest(),
        world=_typed(World, folder, "world.json"),
        evidence=evidence,
        pictures={name: data for name, data in pictures.items() if name not in foreign},
        foreign=foreign,
        versions=_versions(folder),
        findings=_typed(tuple[Diagnostic, ...], folder, FINDINGS) or (),
    )


def _pictures(folder: Path, names: list[str]) -> Iterator[tuple[str, bytes]]:
    """Yield the pictures there are; what is no PNG file is left out."""
    for name in names:
        data = contents_within(folder, name, MOST_BYTES)
        try:
            png_size(data)
        except ValueError:
            continue
        yield name, data


def _foreign(
    looks: list[Look | SketchedLook], pictures: Mapping[str, bytes]
) -> Iterator[str]:
    """Yield the images of looks whose pixels are others than the plan's."""
    for look in looks:
        data = pictures.get(look.scene.image)
        pixels = None if data is None else decoded(data)
        same = pixels is not None and pixels.ndim == 2 and (
            picture_sha256(pixels) == look.scene.image_sha256
        )  # fmt: skip
        if data is not None and not same:
            yield look.scene.image


def _json(folder: Path, name: str) -> Any:
    """Return what a JSON file holds, None if there is none."""
    try:
        return json.loads(contents_within(folder, name, MOST_BYTES))
    except (ValueError, RecursionError):
        return None


def _typed(kind: type[T], folder: Path, name: str) -> T | None:
    """Return what a JSON file holds as a type, None if it does not fit."""
    try:
        return from_data(kind, _json(folder, name))
    except CodecError:
        return None


def _versions(folder: Path) -> dict[str, str]:
    """Return the versions of what made the plan, none if they are not noted."""
    data = _json(folder, "inputs.json")
    found = data.get("versions") if isinstance(data, dict) else None
    if not isinstance(found, dict):
        return {}
    return {str(k): v for k, v in sorted(found.items()) if isinstance(v, str)}
