"""Hostile names: files of another kind, paths that lead elsewhere, no files at all."""

from __future__ import annotations

import os
import shutil
import socket
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.robustness.hostile_task import DRAWING, Case, drawing, task_text
from tests.planner.drawings.dxf_text import circle, dxf

_PNG = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + bytes(range(256)) * 8
_DWG = b"AC1032\0\0\0\0\x04" + bytes(range(256)) * 8
_HTML = "<!DOCTYPE html>\n<html><body><h1>404 Not Found</h1></body></html>\n"
_KINDS: dict[str, str | bytes] = {
    "a PNG": _PNG, "a DWG": _DWG, "an HTML page": _HTML, "nothing": b"",
    "one zero": b"\0", "4096 zeros": bytes(4096), "a line end": b"\n",
    "a zip": b"PK\x03\x04" + bytes(100), "gzip": b"\x1f\x8b\x08" + bytes(100),
    "OASIS": b"%SEMI-OASIS\r\n\x01", "a STEP file": "ISO-10303-21;\nHEADER;\n",
    "an SVG": "<svg xmlns='http://www.w3.org/2000/svg'/>",
    "UTF-16": "0\n".encode("utf-16"),
    "a task": task_text(), "random bytes": bytes(k * k % 251 for k in range(9999)),
}  # fmt: skip


def cases() -> Iterator[Case]:
    """Yield all hostile names."""
    for kind, data in _KINDS.items():
        for file in ("parts/part.dxf", "parts/part.gds"):
            layer = "A" if file.endswith("dxf") else "1/0"
            yield drawing(f"{kind} as {file[-4:]}", data, file=file, layer=layer)
    yield from _elsewhere()
    for what, make in _ODD.items():
        for role, file in (
            ("drawing", DRAWING), ("workcell", "workcell.yaml"), ("task", "task.yaml"),
        ):  # fmt: skip
            yield Case(name=f"{what} as the {role}", put=_instead(file, make))


def _elsewhere() -> Iterator[Case]:
    good = dxf(circle((0, 0), 50))
    names = ("../outside.dxf", "/etc/passwd", "/dev/zero", "/dev/stdin", "~/part.dxf",
             "parts/../../outside.dxf", "C:\\part.dxf", "..\\outside.dxf", "",
             "parts/part.dxf/", "parts/part.dxf/..", ".", "a" * 300, "a/" * 5000,
             "file:///etc/passwd", "http://localhost/part.dxf", "task.yaml",
             "workcell.yaml", "/proc/self/environ", "//etc/passwd")  # fmt: skip
    for name in names:
        said = name if len(name) < 40 else f"{name[:4]}... of {len(name)}"
        yield Case(name=f"a drawing named {said!r}", put=_named(name, good))


def _named(name: str, good: str) -> Callable[[Path], None]:
    def put(folder: Path) -> None:
        (folder.parent / "outside.dxf").write_text(good, encoding="utf-8")
        (folder / DRAWING).write_text(good, encoding="utf-8")
        text = task_text(f"'{name}'")
        (folder / "task.yaml").write_text(text, encoding="utf-8")

    return put


def _instead(file: str, make: Callable[[Path], None]) -> Callable[[Path], None]:
    def put(folder: Path) -> None:
        path = folder / file
        path.unlink(missing_ok=True)
        make(path)

    return put


def _socket(path: Path) -> None:
    """Make a socket; its address may have 107 characters, so it is moved there."""
    near = Path(tempfile.gettempdir(), f"{os.getpid()}.socket")
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(near))
    shutil.move(near, path)


def _link_out(path: Path) -> None:
    target = path.parents[2] / "outside"
    target.write_text(dxf(circle((0, 0), 50)), encoding="utf-8")
    path.symlink_to(target)


def _unreadable(path: Path) -> None:
    """Make a file that nobody may read; an administrator can, and finds it empty."""
    path.touch(mode=0)


_ODD: dict[str, Callable[[Path], None]] = {
    "a pipe": os.mkfifo,
    "a socket": _socket,
    "a folder": Path.mkdir,
    "nothing": lambda _path: None,
    "a link to itself": lambda path: path.symlink_to(path.name),
    "a link to nothing": lambda path: path.symlink_to("nowhere"),
    "a link to /dev/zero": lambda path: path.symlink_to("/dev/zero"),
    "a link to /dev/full": lambda path: path.symlink_to("/dev/full"),
    "a link out of the folder": _link_out,
    "a file without permission": _unreadable,
}
