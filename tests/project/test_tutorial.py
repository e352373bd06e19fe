"""The optics tutorial's numbers are those that its script measures."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

DOCS = Path(__file__).parents[2] / "docs"


def _tutorial() -> ModuleType:
    spec = importlib.util.spec_from_file_location("tutorial", DOCS / "tutorial.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_unknown_argument_is_refused_before_anything_is_drawn(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "argv", ["tutorial.py", "--nonsense"])
    with pytest.raises(SystemExit) as caught:
        _tutorial().main()
    assert caught.value.code == 2


@pytest.fixture(scope="module")
def errors() -> dict[str, list[float]]:
    tutorial = _tutorial()
    found: dict[str, list[float]] = tutorial.errors(tutorial.gear())
    return found


def test_the_page_shows_what_is_measured(errors: dict[str, list[float]]) -> None:
    rows = [
        [cell.strip() for cell in line.split("|")[2:-1]]
        for line in (DOCS / "optics-tutorial.md").read_text().splitlines()
        if line.startswith(("| `", "| defocus ignored"))
    ]
    assert len(rows) == len(errors)
    for row, measured in zip(rows, errors.values(), strict=True):
        # one digit is shown: other machines may round the last bit the other way
        assert [float(cell) for cell in row] == pytest.approx(measured, rel=0.34)


def test_the_paper_is_worse_than_nothing_near_focus(
    errors: dict[str, list[float]],
) -> None:
    assert errors["product"][0] > errors["none"][0]
    assert errors["product"][1] > errors["none"][1]
    for near in range(3):
        assert errors["stokseth"][near] < errors["product"][near] / 10
        assert errors["hopkins"][near] < errors["stokseth"][near]


def test_every_picture_of_the_page_exists() -> None:
    text = (DOCS / "optics-tutorial.md").read_text()
    names = [part.split(")")[0] for part in text.split("](images/")[1:]]
    assert len(names) == 4
    for name in names:
        assert (DOCS / "images" / name).stat().st_size > 5000
