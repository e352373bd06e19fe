"""The plan folder: written whole, then moved into place."""

from __future__ import annotations

import json
import os
import shutil
import stat
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from planner.outputs.errors import OutputError
from planner.pictures import Picture
from schemas import evidence as shown
from schemas.codec import to_data
from schemas.plan import Plan, dump_plan
from schemas.scenes import Scenes
from schemas.world import World

# Enough that rings written as numbers still close when they are read again.
WORLD_DIGITS = 15


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """What reports show of a look, with its pictures by their path in the folder."""

    evidence: shown.LookEvidence
    pictures: Mapping[str, Picture]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanFiles:
    """Everything that goes into a plan folder."""

    plan: Plan
    world: World
    scenes: Scenes
    images: Mapping[str, Picture]  # path in the folder -> (rows, columns) 8 bit
    arrays: Mapping[str, Mapping[str, npt.NDArray[np.float32]]]  # npz path -> arrays
    timings: Mapping[str, float]  # stage -> seconds; never compared
    inputs: Mapping[str, object]  # raw-file hashes and versions; never compared
    shots: tuple[Shot, ...] = ()  # what reports show of each look


def write_folder(files: PlanFiles, folder: Path) -> None:
    """Write the plan folder; an older plan in its place is replaced whole.

    Raises
    ------
    OutputError
        MP701 if `folder` holds something that is no plan, MP702 if it cannot be
        written.
    """
    check_folder(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        try:
            _fill(files, fresh)
            fresh.chmod(0o755)
            swap(fresh, folder)
        except BaseException:
            shutil.rmtree(fresh, ignore_errors=True)
            raise
    except OSError as error:
        raise OutputError("MP702", f"{folder} cannot be written: {error}") from error


def replace_file(source: Path, file: Path) -> None:
    """Copy a file into place, whole or not at all; MP702 if it cannot be written."""
    try:
        data = source.read_bytes()
    except OSError as error:
        raise OutputError("MP702", f"{source} cannot be read: {error}") from error
    _replace(file, data)


def replace_text(file: Path, text: str) -> None:
    """Write a text file, whole or not at all; MP702 if it cannot be written."""
    _replace(file, text.encode())


def _replace(file: Path, data: bytes) -> None:
    """Put data in the place of a file; nothing is left of what fails."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=".microplan.", dir=file.parent)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(data)
            Path(name).chmod(0o644)
            Path(name).replace(file)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError("MP702", f"{file} cannot be written: {error}") from error


def replace_folder(source: Path, folder: Path) -> None:
    """Copy a plan folder into place, whole or not at all; MP701, MP702 as above."""
    check_folder(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        try:
            shutil.copytree(source, fresh, dirs_exist_ok=True)
            fresh.chmod(0o755)
            swap(fresh, folder)
        except BaseException:
            shutil.rmtree(fresh, ignore_errors=True)
            raise
    except OSError as error:
        raise OutputError("MP702", f"{folder} cannot be written: {error}") from error


def check_folder(folder: Path) -> None:
    """Raise OutputError unless `folder` is absent, empty or a plan folder.

    MP701 if it is something else, MP702 if it cannot be told.
    """
    try:
        if not stat.S_ISDIR(folder.stat().st_mode):
            raise OutputError("MP701", f"{folder} is a file, not a folder")
        known = not any(folder.iterdir()) or (folder / "plan.json").is_file()
    except FileNotFoundError:
        return
    except OSError as error:
        raise OutputError("MP702", f"{folder} cannot be written: {error}") from error
    if not known:
        raise OutputError(
            "MP701", f"{folder} holds other things than a plan; it is left untouched"
        )


def _fill(files: PlanFiles, folder: Path) -> None:
    """Write all files into an empty folder."""
    (folder / "images").mkdir()
    (folder / "artifacts").mkdir()
    _write_text(folder / "plan.json", dump_plan(files.plan))
    _write_json(folder / "world.json", to_data(files.world, WORLD_DIGITS))
    _write_json(folder / "scenes.json", to_data(files.scenes, WORLD_DIGITS))
    _write_json(folder / "timings.json", dict(files.timings))
    _write_json(folder / "inputs.json", dict(files.inputs))
    _write_pictures(folder, files.images)
    if files.shots:
        (folder / shown.FOLDER).mkdir()
    for shot in files.shots:
        path = folder / shown.FOLDER / f"{shot.evidence.look}.json"
        _write_json(path, to_data(shot.evidence))
        _write_pictures(folder, shot.pictures)
    for name, arrays in files.arrays.items():
        with (folder / name).open("wb") as stream:
            np.savez(
                stream, allow_pickle=False, **{k: arrays[k] for k in sorted(arrays)}
            )


def _write_pictures(folder: Path, pictures: Mapping[str, Picture]) -> None:
    """Write pictures by their paths in a folder."""
    for name, pixels in pictures.items():
        ok, data = cv2.imencode(".png", pixels)
        if not ok:
            raise OSError(f"{name} could not be encoded")
        (folder / name).write_bytes(data.tobytes())


def _write_json(path: Path, data: object) -> None:
    """Write JSON the way the plan is written."""
    _write_text(path, json.dumps(data, indent=2, ensure_ascii=False) + "\n")


def _write_text(path: Path, text: str) -> None:
    """Write UTF-8 with LF line ends on every platform."""
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(text)


def swap(fresh: Path, folder: Path) -> None:
    """Put `fresh` in the place of `folder`, which is kept until the last moment."""
    if not folder.exists():
        fresh.rename(folder)
        return
    old = fresh.with_name(fresh.name + ".old")
    folder.rename(old)
    try:
        fresh.rename(folder)
    except BaseException:
        old.rename(folder)
        raise
    if old.is_symlink():  # what it leads to is somebody else's
        old.unlink()
    else:
        shutil.rmtree(old)
