"""docs/routines.md: its catalogue is the registry, and its example is a routine."""

from __future__ import annotations

import math
import re
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from microplan.featuresel.look.design import design
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    Measurement,
    Routine,
)
from microplan.featuresel.routines.registry import REGISTRY, load
from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.select import Selection, select
from microplan.featuresel.trials.chains import Chain, chains
from microplan.featuresel.trials.score import ChainScore, score
from microplan.featuresel.trials.trials import prepare, run
from tests.featuresel.conftest import make_case, noisy, post_alone

PAGE = (Path(__file__).parents[3] / "docs" / "routines.md").read_text(encoding="utf-8")
NAME = "grey_centroid"
CHAIN = ("otsu", NAME)
TOLERANCE_UM = 0.3


def catalogue() -> dict[str, list[str]]:
    """Return the cells of the catalogue by routine."""
    table = PAGE.partition("## The catalogue")[2].partition("\n*")[0]
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in table.splitlines()
        if line.startswith("| `")
    ]
    return {row[0].strip("`"): row[1:] for row in rows}


def register(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Return the page's routine as a module, registered by one line."""
    path = f"microplan.featuresel.routines.{NAME}"
    assert f'"{NAME}": _HERE + "{NAME}:{NAME.upper()}",' in PAGE
    source = PAGE.partition("```python\n")[2].partition("```")[0]
    module = ModuleType(path)
    exec(compile(source, NAME, "exec"), module.__dict__)
    monkeypatch.setitem(sys.modules, path, module)
    assert isinstance(REGISTRY, dict)
    monkeypatch.setitem(REGISTRY, NAME, f"{path}:{NAME.upper()}")
    return module


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Return the page's routine, registered."""
    return register(monkeypatch)


def test_the_catalogue_is_the_registry() -> None:
    assert list(catalogue()) == sorted(REGISTRY)
    for name, cells in catalogue().items():
        kinds, gives, needs, captures, good, bad, role = cells
        routine = load(name)
        assert kinds == ", ".join(routine.kinds)
        assert gives == ", ".join(routine.provides)
        assert needs == ", ".join(routine.requires)
        reach = routine.capture_px
        assert captures == ("search" if math.isinf(reach) else f"{reach:g} px")
        roles = ("baseline", routine.baseline), ("expensive", routine.expensive)
        assert role == ", ".join(word for word, holds in roles if holds)
        assert good
        assert bad


def test_pages_that_are_pointed_to_exist() -> None:
    found = re.findall(r"\]\(([\w.-]+\.md)(?:#([\w-]+))?\)", PAGE)
    assert found
    for name, anchor in found:
        text = (Path(__file__).parents[3] / "docs" / name).read_text(encoding="utf-8")
        heads = re.findall(r"^#+ (.+)$", text, re.M)
        assert not anchor or anchor in {h.lower().replace(" ", "-") for h in heads}


def test_the_example_keeps_the_contract(example: ModuleType) -> None:
    assert load(NAME) is example.GREY_CENTROID
    case, artifact = post_alone(), ready(load(NAME))
    shape = (case.window.rows, case.window.columns)
    true = nominal_render(case)()
    start = Guess(column=case.target.column, row=case.target.row)
    assert isinstance(load(NAME).measure(true, artifact, start), Measurement)
    assert load(NAME).cost(artifact, true.size) > 0
    others = {
        "blank": np.full(shape, 0.4),
        "black": np.zeros(shape),
        "saturated": np.ones(shape),
        "noise": np.random.default_rng(4).random(shape),
        "negative": 1 - true,
        "tiny": true[:8, :8],
        "cut": true[:, : int(start.column)],
    }
    for name, image in others.items():
        kept = image.copy()
        assert isinstance(load(NAME).measure(image, artifact, start), Failure), name
        np.testing.assert_array_equal(image, kept)


def test_the_example_refuses_what_it_cannot_look_for(example: ModuleType) -> None:
    nothing = make_case("circle", {"radius_um": 22.0}, ())
    found = load(NAME).prepare(nominal_render(nothing), nothing.target)
    assert isinstance(found, Failure)
    assert found.code == "no_contrast"
    small = make_case("circle", {"radius_um": 22.0}, (), half_px=(20, 20))
    found = load(NAME).prepare(nominal_render(small), small.target)
    assert isinstance(found, Failure)
    assert found.code == "outside"


def test_the_example_knows_its_spread_in_even_light(example: ModuleType) -> None:
    case, artifact = post_alone(), ready(load(NAME))
    render, rng = nominal_render(case), np.random.default_rng(1)
    start = Guess(column=case.target.column, row=case.target.row)
    squares = []
    for dx, dy in rng.uniform(-2, 2, (64, 2)):
        image = noisy(case, render(dx_um=dx, dy_um=dy), rng)
        found = load(NAME).measure(image, artifact, start)
        assert isinstance(found, Measurement)
        assert found.spread_px == pytest.approx(0.005, rel=0.1)  # as the page says
        x, y = case.frame.to_world(found.column, found.row)
        spread_um = found.spread_px * case.microscope.um_per_px
        squares += [((x - case.x_um - dx) / spread_um) ** 2]
        squares += [((y - case.y_um - dy) / spread_um) ** 2]
    # 128 squares of normals: a standard deviation of sqrt(2 / 128), three of them
    assert np.mean(squares) == pytest.approx(1.0, abs=3 * math.sqrt(2 / 128))


def test_one_line_makes_candidates_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    target = post_alone().target
    before = chains(target)
    assert all(NAME not in chain for chain in before)
    register(monkeypatch)
    after = chains(target)
    assert CHAIN in after
    assert ("circle_caliper", NAME) in after
    assert (NAME,) not in after  # its start is farther off than it captures


def test_trials_and_selection_judge_it(example: ModuleType) -> None:
    scores, selection = judged()
    mine = scores[CHAIN]
    assert mine.trials == mine.success == 24
    reasons = dict(selection.reasons)
    assert set(reasons) == {("otsu",), CHAIN}
    assert reasons["otsu",].startswith("chosen: 2 sigma + |bias| ")
    assert reasons[CHAIN].startswith("fallback: 2 sigma + |bias| ")
    words = " ".join(PAGE.split())
    for chain, need in ((("otsu",), scores["otsu",]), (CHAIN, mine)):
        role = "chosen" if chain == ("otsu",) else "fallback"
        said = re.search(rf'"{role}: 2 sigma \+ \|bias\| ([\d.]+) um, cost ([\d.]+)',
                         words)  # fmt: skip
        assert said
        # of two or three digits
        assert float(said[1]) == pytest.approx(need.need_um, rel=0.01)
        assert float(said[2]) == pytest.approx(need.cost, rel=0.01)
    said = re.search(r"errors are ([\d.]+) times larger in x .* ([\d.]+) times in y",
                     words)  # fmt: skip
    assert said
    assert mine.spread_x
    assert mine.spread_y
    assert float(said[1]) == pytest.approx(mine.spread_x.factor, rel=0.01)
    assert float(said[2]) == pytest.approx(mine.spread_y.factor, rel=0.01)


def test_gradient_and_zoom_are_what_the_example_does_not_know(
    example: ModuleType,
) -> None:
    case = post_alone()
    spread = replace(case.spread, light_gradient=(0.0, 0.0), magnification_sigma=0.0)
    case = replace(case, spread=spread)
    prepared = prepare(case, [CHAIN])
    outcomes = run(case, prepared, design(case, 24, root_seed=3))
    (found,) = score(case, prepared, outcomes)
    for own in (found.spread_x, found.spread_y):
        assert own
        # the root of 24 squares of normals, three standard deviations
        assert own.factor == pytest.approx(1.0, abs=3 / math.sqrt(2 * 24))


def ready(routine: Routine) -> Artifact:
    """Return the artifact for the post."""
    case = post_alone()
    artifact = routine.prepare(nominal_render(case), case.target)
    assert isinstance(artifact, Artifact), artifact
    return artifact


@cache
def judged() -> tuple[dict[Chain, ChainScore], Selection]:
    """Return scores and verdicts of a threshold, alone and before the example."""
    case = post_alone()
    prepared = prepare(
        case, [c for c in chains(case.target) if c in (("otsu",), CHAIN)]
    )
    outcomes = run(case, prepared, design(case, 24, root_seed=3))
    scores = score(case, prepared, outcomes)
    selection = select(
        scores,
        Constraints(
            tolerance_um=TOLERANCE_UM, tolerance_theta_rad=None, target=case.target
        ),
    )
    return {s.chain: s for s in scores}, selection
