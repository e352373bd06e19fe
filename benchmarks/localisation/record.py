"""What a long benchmark has measured already, kept by what it depends on.

One JSON line a result: its key is a hash of the settings and of all code that it comes
from, so that a run which was stopped goes on, and a change of code starts anew.
"""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Iterator, Mapping
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

Value = dict[str, object]

ROOT = Path(__file__).parents[2]
RECORD = ROOT / "build" / "localisation.jsonl"
_LIBRARIES = ("numpy", "scipy", "opencv-contrib-python-headless")
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def key_of(settings: Mapping[str, object], code: str) -> str:
    """Return the key of what is measured with some settings by some code."""
    text = json.dumps({"settings": dict(settings), "code": code}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def recorded(path: Path) -> dict[str, Value]:
    """Return all results of a record by key, the last of equal keys.

    A last line without its end, of a run that was killed, is passed over.
    """
    if not path.exists():
        return {}
    found: dict[str, Value] = {}
    for line in path.read_text(encoding="utf-8").splitlines(keepends=True):
        if line.endswith("\n"):
            entry = json.loads(line)
            found[entry["key"]] = entry["value"]
    return found


def record(path: Path, key: str, value: Value) -> None:
    """Append one result, in the place of a last line without its end.

    Raises
    ------
    ValueError
        If the value holds a nan or infinity.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    line = json.dumps({"key": key, "value": value}, allow_nan=False) + "\n"
    with path.open("ab+") as file:
        file.seek(0)
        data = file.read()
        file.truncate(data.rfind(b"\n") + 1)
        file.write(line.encode())


def code_of(*modules: str) -> str:
    """Return a hash of modules, all that they import of this project, and libraries.

    Comments, docstrings and layout do not count. What a module loads by name, as the
    registry of routines does, is to be given.

    Raises
    ------
    ValueError
        If there is no such module.
    """
    known: dict[str, str] = {}
    wanted = list(modules)
    while wanted:
        name = wanted.pop()
        if name in known:
            continue
        file = _file(name)
        if file is None:
            raise ValueError(f"no module {name} in {ROOT}")
        known[name], imported = _parsed(file.read_text(encoding="utf-8"))
        wanted += [other for other in imported if _file(other)]
    text = json.dumps([sorted(known.items()), [(n, version(n)) for n in _LIBRARIES]])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@lru_cache(maxsize=2048)  # a benchmark asks for each module by many routines
def _parsed(text: str) -> tuple[str, tuple[str, ...]]:
    """Return a module's code without layout, and the names that it imports."""
    tree = ast.parse(text)
    return ast.dump(_bare(tree)), tuple(_imports(tree))


def _file(name: str) -> Path | None:
    """Return the file of a module or package of this project."""
    path = ROOT.joinpath(*name.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return file
    return None


def _imports(tree: ast.Module) -> Iterator[str]:
    """Yield the names that may be modules, with the packages that they lie in."""
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            words = name.split(".")
            yield from (".".join(words[:n]) for n in range(1, len(words) + 1))


def _bare(tree: ast.Module) -> ast.Module:
    """Return the module without docstrings; it is changed in place."""
    for node in ast.walk(tree):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return tree
