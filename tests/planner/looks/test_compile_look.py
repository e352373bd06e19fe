"""Which zoom a look is compiled at, by what is asked of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from microplan.optics.outline.outline import Arc, Outline, Ring
from microplan.planner.assembly.step_states import unfold
from microplan.planner.looks.compile_look import compile_look, look_at_first
from microplan.planner.looks.feature_evaluation import (
    evaluate_features,
    without_chains,
)
from microplan.planner.looks.look_problem import Begun, CompileContext, LookProblem
from microplan.planner.looks.look_record import CompiledLook
from microplan.planner.looks.scenario import build_case
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.store.store import Store, place
from microplan.planner.task.task import Task
from microplan.planner.views.requests import Request, requests
from microplan.planner.views.target_views import views
from tests.planner.examples import FEW, copy_example, one_look, read

A = TypeVar("A")
B = TypeVar("B")


def few_trials() -> CompileContext:
    """Return a context of few trials; what other tests have computed is kept."""
    kept = Memo(Store(place()))
    return CompileContext(effort=FEW, max_image_error=0.06, map=map, memo=kept)


def test_a_look_stays_at_its_zoom_if_the_insertion_after_it_bears_that(
    tmp_path: Path,
) -> None:
    """A nanometre is beyond every routine, a micrometre beyond none."""
    file = copy_example(tmp_path / "task")
    one_look(file)
    task, report = read(file), Report()
    (asked,) = requests(task, unfold(task, report), 0, None)
    effects = few_trials()
    low, _ = task.workcell.optics.magnification

    def compiled(request: Request) -> CompiledLook | None:
        return compile_look(task, request, effects, low, report, once=True)

    short = replace(asked, tolerance_um=1e-3)
    assert compiled(short) is None
    kept = compiled(replace(short, admissible_um=1.0))
    assert kept is not None
    assert kept.look.view.magnification == low
    assert kept.look.verdict is not None
    assert kept.look.verdict.zoom.refused == ()
    assert 1e-3 < 2 * kept.look.sigma_xy_um < 1.0


def test_a_look_stays_at_its_zoom_where_the_jump_of_another_would_cost_more(
    tmp_path: Path,
) -> None:
    """The best chain is taken, not the cheapest within what would be worth it."""
    file = copy_example(tmp_path / "task")
    one_look(file)
    task, report = read(file), Report()
    (asked,) = requests(task, unfold(task, report), 0, None)
    effects = few_trials()
    low, _ = task.workcell.optics.magnification
    short = replace(asked, tolerance_um=1e-3, admissible_um=2e-3)

    kept = compile_look(
        task, replace(short, break_even_um=5.0), effects, low, report, once=True
    )
    loose = compile_look(
        task, replace(asked, tolerance_um=5.0), effects, low, report, once=True
    )
    assert kept is not None
    assert loose is not None
    assert kept.look.sigma_xy_um < loose.look.sigma_xy_um


def test_a_case_is_built_once_whatever_it_has_to_meet(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    one_look(file)
    task, report, begun = read(file), Report(), Begun()
    (asked,) = requests(task, unfold(task, report), 0, None)
    low, _ = task.workcell.optics.magnification
    view, *_ = views(task, asked, low, report)
    for request in (
        asked,
        replace(asked, tolerance_um=2.0, asked_by="nobody", admissible_um=3.0),
        replace(asked, needs_angle_rad=0.1),
    ):
        built = begun.case(task, request, view, 0.01, EVERY_TIME)
        assert built == build_case(task, request, view, 0.01)
    assert len(begun.cases) == 2  # an angle is another look


def tubular(task: Task) -> Task:
    """Return the task with a post that has another rim inside its own."""
    plate = task.parts["shaft_plate"]
    post = plate.posts["post"]
    bore = Arc(center=(0.0, 0.0), radius_um=6.0, start_rad=0.0, sweep_rad=-math.tau)
    tube = Outline(rings=(*post.outline.rings, Ring(edges=(bore,))))
    plate = replace(plate, posts={"post": replace(post, outline=tube)})
    return replace(task, parts={**task.parts, plate.name: plate})


def test_what_a_look_begins_with_is_not_done_again(tmp_path: Path) -> None:
    """Other features are raced ahead, and at their turn with another tolerance."""
    file = copy_example(tmp_path / "task")
    one_look(file)
    task, report, begun, asked = tubular(read(file)), Report(), Begun(), [0]

    def counted(work: Callable[[A], B], items: Iterable[A], /) -> Iterator[B]:
        for item in items:
            asked[0] += 1
            yield work(item)

    (request,) = requests(task, unfold(task, report), 0, None)
    effort = replace(FEW, limited=True, features=1)
    effects = CompileContext(effort=effort, max_image_error=0.06, map=counted)
    low, _ = task.workcell.optics.magnification
    view, *_ = views(task, request, low, report)
    look_at_first(task, replace(request, tolerance_um=0.02), effects, view, begun)
    (other,) = begun.others.values()
    assert len(other.known.outcomes.all()) >= 8

    found = []
    request = replace(request, tolerance_um=0.15)
    for known in (begun, replace(begun, others={})):
        job = LookProblem(task=task, request=request, context=effects, begun=known)
        asked[0] = 0
        raced, _ = evaluate_features(job, job.evaluate(view))
        found.append((asked[0], [each.tried.comparison.scores for each in raced]))
    (afterwards, scores), (anew, fresh) = found
    assert afterwards == 0 < anew
    assert len(scores) == 2
    assert scores == fresh

    first, *_ = raced
    assert without_chains(first, {}).chosen == first.chosen
    chain, why = first.chosen.chain, "errors of images: too few pairs"
    left = without_chains(first, {chain: why}).tried.comparison.selection
    assert left.chosen is None or left.chosen.chain != chain
    assert why in dict(left.reasons)[chain]
