"""The order of the house: folders, signs, names, docstrings."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

from benchmarks import house
from tests.module_times import SLOWEST

ROOT = house.ROOT
MOST_MODULES = 15  # in a folder
MOST_LINES = 350  # of a module
MOST_ROWS = 10  # of a contract of layers
LEAST_COMPLETE = 0.9  # of the docstrings of public functions with arrays
# folders of tests that watch several folders of their package, or what it writes
ACROSS = {"whole_runs", "zoo", "extremes"}


def test_no_folder_is_a_hall() -> None:
    folders = Counter(house.folder_sizes())
    for top in ("tests", "benchmarks", "microplan"):
        files = [f for f in (ROOT / top).rglob("*.py") if f.name != "__init__.py"]
        inside = (f for f in files if not f.relative_to(ROOT / top).is_symlink())
        folders.update(f.parent.relative_to(ROOT).as_posix() for f in inside)
    assert {k: v for k, v in folders.items() if v > MOST_MODULES} == {}


def test_no_module_is_too_long_to_hold_one_idea() -> None:
    sizes = {f: len(f.read_text("utf-8").splitlines()) for f in house.modules()}
    assert {f.as_posix(): n for f, n in sizes.items() if n > MOST_LINES} == {}


def test_two_words_find_any_module() -> None:
    for package in house.PACKAGES:
        files = [f for f in (ROOT / package).rglob("*.py") if f.name != "__init__.py"]
        words = Counter((f.parent.name, f.stem) for f in files)
        assert [name for name, count in words.items() if count > 1] == []


def test_a_class_name_means_one_thing() -> None:
    assert house.names_twice() == {}


def test_signs_at_the_doors_say_what_passes() -> None:
    for file in house.modules():
        if file.name != "__init__.py":
            continue
        tree = ast.parse(file.read_text(encoding="utf-8"))
        text = ast.get_docstring(tree) or ""
        place = file.relative_to(ROOT).as_posix()
        assert 5 <= len(text.splitlines()) <= 16, place
        for word in ("In:", "Out:", "May be touched here:", "Watched by:"):
            assert word in text, f"{place}: {word}"
        kinds = (ast.Expr, ast.Import, ast.ImportFrom, ast.Assign)
        assert all(isinstance(node, kinds) for node in tree.body), place


def test_the_tests_that_signs_name_exist() -> None:
    for file in house.modules():
        if file.name == "__init__.py":
            text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
            watched = text.partition("Watched by:")[2]
            names = [word.strip("`,.;()") for word in watched.split()]
            paths = [name for name in names if name.startswith("tests/")]
            place = file.relative_to(ROOT).as_posix()
            assert paths, place
            assert [p for p in paths if not (ROOT / p).exists()] == [], place


def test_contracts_are_short_and_no_folder_holds_a_circle() -> None:
    assert house.contract_rows() <= MOST_ROWS
    assert house.circles() == 0


def test_public_functions_state_the_shapes_and_units_of_their_arrays() -> None:
    complete = [found for *_, found in house.array_functions()]
    assert sum(complete) / len(complete) >= LEAST_COMPLETE


def test_tests_mirror_the_folders() -> None:
    for package in house.PACKAGES:
        for folder in (ROOT / "tests" / package).rglob("*"):
            if folder.is_dir() and folder.name != "__pycache__":
                inside = folder.relative_to(ROOT / "tests")
                mirrored = (ROOT / inside).is_dir() or folder.name in ACROSS
                assert mirrored, inside.as_posix()


def test_no_folder_has_a_name_that_says_nothing() -> None:
    empty = {"rest", "misc", "core", "tools", "utils", "helpers", "common", "base"}
    folders = {file.parent for file in house.modules()}
    assert [f for f in folders if f.name in empty] == []
    assert all(Path(f, "__init__.py").is_file() for f in folders)


def test_the_slowest_test_modules_are_still_there() -> None:
    assert [name for name in SLOWEST if not (ROOT / name).is_file()] == []
