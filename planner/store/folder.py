"""Files or plan folders written atomically: whole, or not at all."""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from microplan.planner.source.diagnostics import CallError


class OutputError(CallError):
    """The output cannot be written; the message says why, `code` is MP7xx."""


def not_written(
    file: str | os.PathLike[str], error: OSError | ValueError
) -> OutputError:
    """Return MP702 for an error on the way: files that the user never named stay out.

    An OSError's own words hold the path that failed, which may be of a file that is
    moved there only when it is whole.
    """
    why = error.strerror if isinstance(error, OSError) else ""
    path = os.fspath(file)
    return OutputError("MP702", f"{path} cannot be written: {why or error}", path)


if TYPE_CHECKING:
    from microplan.schemas.plan import Plan

PLAN = "plan.json"
REPORT = "report.html"
FINDINGS = "findings.json"
_ALWAYS = ("images", "artifacts")  # folders of every plan, empty or not
_FOLDERS = (*_ALWAYS, "evidence", "fits")
# all names in a plan folder: with another one it may hold a user's own files
_OURS = {
    PLAN, "world.json", "scenes.json", "inputs.json", "timings.json", REPORT,
    FINDINGS,
    *_FOLDERS,
}  # fmt: skip
# How every plan begins, since 1.0: other programs write a plan.json too, also with a
# "format_version". Its types are not loaded for that: an unchanged task needs none.
_HEAD = re.compile(
    rb'\{\s*"format_version"\s*:\s*"\d+\.\d+"\s*,\s*"name"\s*:\s*"[^"]*"\s*,'
    rb'\s*"status"\s*:\s*"(?:(in)?feasible|sketch)"\s*,\s*"reasons"\s*:'
)
_HEAD_BYTES = 1 << 12  # a name has 64 letters


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanBytes:
    """A plan folder as it will lie on the disc, and what is said of it."""

    name: str  # of the task
    files: Mapping[str, bytes]  # path in the folder, with "/" -> what it holds
    timings: Mapping[str, float]  # stage -> seconds; never compared
    summary: str

    def __post_init__(self) -> None:
        if PLAN not in self.files:
            raise ValueError(f"a plan folder has a {PLAN}, got {sorted(self.files)}")
        for path in map(PurePosixPath, self.files):
            if path.is_absolute() or ".." in path.parts:
                raise ValueError(f"{path} lies outside the folder")

    def plan(self) -> Plan:
        """Return the plan in it."""
        # loaded where it is wanted: an unchanged task's is written and not read
        from microplan.schemas.plan import parse_plan

        return parse_plan(self.files[PLAN].decode("utf-8"))


def write_folder(made: PlanBytes, folder: Path) -> None:
    """Write a plan folder; an older plan at its path is replaced whole.

    Raises
    ------
    OutputError
        MP701 if `folder` holds something that is no plan, MP702 if it cannot be
        written.
    """
    check_folder(folder)
    replace_by(folder, partial(_fill, made))


def replace_by(folder: Path, fill: Callable[[Path], object]) -> None:
    """Replace a folder by another one, whole or not at all.

    `fill` writes into a fresh folder; MP702 if that or the move fails.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        try:
            fill(fresh)
            fresh.chmod(0o755)
            swap(fresh, folder)
        except BaseException:
            shutil.rmtree(fresh, ignore_errors=True)
            raise
    except (OSError, ValueError) as error:
        raise not_written(folder, error) from error


def replace_file(source: Path, file: Path) -> None:
    """Copy a file, whole or not at all; MP702 if it cannot be written."""
    try:
        data = source.read_bytes()
    except OSError as error:
        why = f"{source} cannot be read: {error.strerror or error}"
        raise OutputError("MP702", why, source) from error
    replace_bytes(file, data)


def replace_alike(file: Path, data: bytes, *, head: int = 16) -> None:
    """Write a new file, or replace one that begins with the same bytes.

    Raises
    ------
    OutputError
        MP703 if another file is there, MP702 if it cannot be written.
    """
    try:
        with file.open("rb") as stream:
            begin = stream.read(head)
    except FileNotFoundError:
        begin = data[:head]
    except OSError as error:
        raise not_written(file, error) from error
    if begin != data[:head]:
        message = f"{file} is there already, and nothing that this replaces"
        raise OutputError("MP703", f"{message}; it is left untouched", file)
    replace_bytes(file, data)


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder, made if need be, each replacing an older one."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise not_written(folder, error) from error
    for name, data in files.items():
        replace_bytes(folder / name, data)


def replace_bytes(file: Path, data: bytes) -> None:
    """Write a file, whole or not at all; MP702 if it cannot be written."""
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
    except (OSError, ValueError) as error:
        raise not_written(file, error) from error


def replace_folder(source: Path, folder: Path) -> None:
    """Copy a plan folder, whole or not at all; MP701, MP702 as above."""
    check_folder(folder)
    replace_by(folder, partial(shutil.copytree, source, dirs_exist_ok=True))


def check_folder(folder: Path) -> None:
    """Raise OutputError unless `folder` is absent, empty or a plan folder alone.

    MP701 if it is something else, as one whose plan.json is another program's; MP702 if
    that cannot be found out.
    """
    try:
        if not stat.S_ISDIR(folder.stat().st_mode):
            raise OutputError("MP701", f"{folder} is a file, not a folder", folder)
        held = {path.name for path in folder.iterdir()}
    except FileNotFoundError:
        return
    except OSError as error:
        raise not_written(folder, error) from error
    if held and not (PLAN in held and held <= _OURS):
        foreign = sorted(held - _OURS)
        said = f"{foreign[0]!r} for one" if foreign else f"and no {PLAN}"
        message = f"{folder} holds other things than a plan, {said}"
        raise OutputError("MP701", f"{message}; it is left untouched", folder)
    if held:
        check_file(folder / PLAN)
        _check_within(folder)


def _check_within(folder: Path) -> None:
    """Raise OutputError, MP701, if a plan's own folders hold what it does not name.

    A file there has its path in the plan, or begins with the id of a look.
    """
    try:
        plan = (folder / PLAN).read_bytes()
        for name in _FOLDERS:
            held = sorted((folder / name).iterdir()) if (folder / name).is_dir() else []
            for path in held:
                if path.is_dir() or not _is_named(f"{name}/{path.name}", plan):
                    message = f"{path} is not of the plan beside it"
                    raise OutputError(
                        "MP701", f"{message}; all is left untouched", path
                    )
    except OSError as error:
        raise not_written(folder, error) from error


def _is_named(path: str, plan: bytes) -> bool:
    """Return whether a plan names a file, or the look that the file begins with."""
    name = path.partition("/")[2]
    looks = (name[: dot.start()] for dot in re.finditer(r"\.", name))
    return any(f'"{word}"'.encode() in plan for word in (path, *looks))


def check_file(file: Path) -> None:
    """Raise OutputError unless `file` is absent or a plan; codes as `check_folder`."""
    try:
        ours = stat.S_ISREG(file.stat().st_mode) and _HEAD.match(_begin(file))
    except FileNotFoundError:
        return
    except OSError as error:
        raise not_written(file, error) from error
    if not ours:
        message = f"{file} is no plan of microplan; it is left untouched"
        raise OutputError("MP701", message, file)


def _begin(file: Path) -> bytes:
    """Return the first bytes of a file."""
    with file.open("rb") as stream:
        return stream.read(_HEAD_BYTES).lstrip()


def _fill(made: PlanBytes, folder: Path) -> None:
    """Write all files into an empty folder."""
    held = {path.rpartition("/")[0] for path in made.files} - {""}
    for name in sorted({*held, *_ALWAYS}):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for path, data in made.files.items():
        (folder / path).write_bytes(data)
    (folder / "timings.json").write_bytes(json_bytes(dict(made.timings)))


def json_bytes(data: object) -> bytes:
    """Return JSON as plans are written."""
    return (json.dumps(data, indent=2, ensure_ascii=False) + "\n").encode(
        "utf-8",
        "backslashreplace",  # names of files need not be text
    )


def swap(fresh: Path, folder: Path) -> None:
    """Replace `folder` by `fresh`; it is kept until the last moment."""
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
