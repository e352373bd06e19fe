"""Figures of the house: folders, contracts, modules, lines, docs, docstrings, names."""

from __future__ import annotations

import ast
import io
import re
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import grimp

from benchmarks.figures import Benchmark, Figure, Options

ROOT = Path(__file__).parents[1]
PACKAGES = ("planner", "executor", "featuresel", "optics", "schemas")
_ARRAY = re.compile(r"\b\w*Array\b|\bNDArray\b")
# (N, 2), (rows, columns), (K,), (...), (2 R + 1, M): sizes that are named or numbers
_SIZE = r"(?:\.\.\.|\d+|(?:\d+ )?[A-Z]\w*(?: [-+*/] (?:\d+|[A-Z]\w*))*|rows|columns)"
_SHAPE = re.compile(rf"\({_SIZE}(?:, ?{_SIZE})*,?\)")
_UNIT = re.compile(
    r"_(?:um2?|nm|px|rad|deg|s|ms|per_\w+|e|nn|counts?)\b|\b(?:um|px|rad|pixels?|cycles"
    r"|degrees|electrons|counts?|full scale|shares?|dimensionless|waves?|samples?"
    r"|indices|contrast|true|True|probabilit\w+|um\^?2)\b|\[1\]|\b0\.\.1\b"
)


def modules() -> list[Path]:
    """Return every module of the five packages, signs at the doors included."""
    return sorted(f for name in PACKAGES for f in (ROOT / name).rglob("*.py"))


def folder_sizes() -> Counter[str]:
    """Return the number of modules by folder, signs at the doors left out."""
    inside = (f for f in modules() if f.name != "__init__.py")
    return Counter(f.parent.relative_to(ROOT).as_posix() for f in inside)


def contract_rows() -> int:
    """Return the rows of the longest contract of layers."""
    with (ROOT / "pyproject.toml").open("rb") as stream:
        contracts = tomllib.load(stream)["tool"]["importlinter"]["contracts"]
    return max(len(c["layers"]) for c in contracts if c["type"] == "layers")


def circles() -> int:
    """Return how many folders hold siblings that import each other in a circle."""
    graph = grimp.build_graph("microplan")
    folders = {m for m in graph.modules if graph.find_children(m)}
    return sum(bool(graph.nominate_cycle_breakers(folder)) for folder in folders)


def code_lines(text: str) -> int:
    """Return the lines that hold code: neither blank, comment nor docstring."""
    held: set[int] = set()
    skipped = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT,
               tokenize.DEDENT, tokenize.ENDMARKER)  # fmt: skip
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in skipped:
            held.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            body = node.body
            if body and isinstance(body[0], ast.Expr) and ast.get_docstring(node):
                held -= set(range(body[0].lineno, (body[0].end_lineno or 0) + 1))
    return len(held)


def array_functions() -> Iterator[tuple[str, str, bool]]:
    """Yield file, name and whether the docstring of a public function is complete.

    Public functions and methods that take or give arrays state shapes and units.
    """
    for file in modules():
        tree = ast.parse(file.read_text(encoding="utf-8"))
        classes = (n for n in tree.body if isinstance(n, ast.ClassDef))
        owners: list[ast.Module | ast.ClassDef] = [tree, *classes]
        for owner in owners:
            if isinstance(owner, ast.ClassDef) and owner.name.startswith("_"):
                continue
            for node in owner.body:
                if not isinstance(node, ast.FunctionDef) or node.name.startswith("_"):
                    continue
                said = [*(a.annotation for a in _arguments(node)), node.returns]
                if any(a is not None and _ARRAY.search(ast.unparse(a)) for a in said):
                    text = ast.get_docstring(node) or ""
                    named = " ".join(
                        (text, node.name, *(a.arg for a in _arguments(node)))
                    )
                    complete = _SHAPE.search(text) and _UNIT.search(named)
                    yield file.relative_to(ROOT).as_posix(), node.name, bool(complete)


def names_twice() -> dict[str, list[str]]:
    """Return the names of classes that stand in several modules, and where."""
    found: dict[str, list[str]] = {}
    for file in modules():
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                place = file.relative_to(ROOT).as_posix()
                found.setdefault(node.name, []).append(place)
    return {name: places for name, places in found.items() if len(places) > 1}


def words_in_docs() -> int:
    """Return the words of all pages in docs/."""
    pages = (ROOT / "docs").rglob("*.md")
    return sum(len(page.read_text(encoding="utf-8").split()) for page in pages)


def _arguments(node: ast.FunctionDef) -> list[ast.arg]:
    return [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]


def _measure(_options: Options) -> Iterator[Figure]:
    texts = [file.read_text(encoding="utf-8") for file in modules()]
    shaped = [complete for _, _, complete in array_functions()]
    figures = {
        "house.largest_folder": (max(folder_sizes().values()), "modules"),
        "house.longest_contract": (contract_rows(), "rows"),
        "house.import_circles": (circles(), "1"),
        "house.modules": (len(texts), "1"),
        "house.source_lines": (sum(len(t.splitlines()) for t in texts), "lines"),
        "house.code_lines": (sum(map(code_lines, texts)), "lines"),
        "house.docs_words": (words_in_docs(), "words"),
        "house.arrays_with_shapes": (sum(shaped) / len(shaped), "1"),
        "house.names_twice": (len(names_twice()), "1"),
    }
    for name, (value, unit) in figures.items():
        yield Figure(name=name, value=value, unit=unit)


NAMES = (
    "house.largest_folder", "house.longest_contract", "house.import_circles",
    "house.modules", "house.source_lines", "house.code_lines", "house.docs_words",
    "house.arrays_with_shapes", "house.names_twice",
)  # fmt: skip
BENCHMARK = Benchmark(names=NAMES, measure=_measure)
