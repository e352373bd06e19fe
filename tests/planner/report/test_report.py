"""The report of a plan: one page from the plan folder, whatever names it holds."""

from __future__ import annotations

import math
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from microplan.planner.cli.main import main
from microplan.planner.report.budgets import yield_advice
from microplan.planner.report.errors import ellipse, sigmas
from microplan.planner.report.folder import ReportedPlan, read_folder
from microplan.planner.report.margins import margins, methods
from microplan.planner.report.pictures import place_id
from microplan.planner.report.report import plan_report, write_report
from microplan.planner.report.trials import accuracy
from microplan.schemas.files.times import planned_s, spans
from microplan.schemas.page.elements import write
from microplan.schemas.plan import Look, Plan, Reason, Step, VerifyAction, dump_plan
from microplan.schemas.plan.verdicts import Change
from tests.names import renamed
from tests.pages import Page, check_page
from tests.planner.few_trials import MAX_IMAGE_ERROR

EVIL = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def folder(compiled_example: Path) -> ReportedPlan:
    """Return the example's plan folder."""
    return read_folder(compiled_example)


@pytest.fixture(scope="module")
def page(folder: ReportedPlan) -> Page:
    """Return the example's report."""
    return check_page(plan_report(folder))


def test_the_same_plan_gives_the_same_bytes(
    compiled_example: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = Path(shutil.copytree(compiled_example, tmp_path / "copy.plan"))
    assert main(["report", str(copy)]) == 0
    assert f"report: {copy / 'report.html'}" in capsys.readouterr().out
    again = write_report(compiled_example / "plan.json", tmp_path / "out" / "r.html")
    assert again.read_bytes() == (copy / "report.html").read_bytes()


def test_the_first_page_has_what_is_passed_on(folder: ReportedPlan, page: Page) -> None:
    text, plan = " ".join(page.text), folder.plan
    assert "Feasible" in text
    assert f"P(success) {plan.success_probability:.4f}" in text
    insert = next(s for s in plan.steps if s.verb == "insert")
    assert insert.budget.analysis is not None
    for offender in insert.budget.analysis.offenders[:3]:
        assert offender.term in text
    for digest in (folder.sha256, plan.provenance.task_sha256):
        assert digest in text
    for words in ("Tightest margin", "Yield over", "Depth of field", "Methods",
                  "Stay below about", "the capture radius as drawn",
                  f"microplan {plan.provenance.microplan}"):  # fmt: skip
        assert words in text


def test_one_fit_has_one_capture_radius(folder: ReportedPlan, page: Page) -> None:
    insert = next(s for s in folder.plan.steps if s.verb == "insert")
    text, limit = " ".join(page.text), insert.budget.limit_um
    assert limit == pytest.approx(2.9)  # half of 50 less 44, less half the taper of .2
    assert "capture radius as drawn 2.9\u202f\u00b5m" in text
    assert "goes in within" not in text
    assert "cut off at" not in " ".join(_do(page))
    assert "0.045\u202f\u00b5N" in text
    assert "0.045 to 0.045" not in text
    assert f"{MAX_IMAGE_ERROR} unit contrast" in text


def _do(page: Page) -> list[str]:
    """Return what a page says to do about bars."""
    return [words for words in page.text if "Begin with the longest bar" in words]


def test_a_range_along_one_axis_says_so_and_colours_are_told(page: Page) -> None:
    text = " ".join(page.text)
    assert (
        "with the zoom at nominal all looks stand it, with both off perhaps less"
        in text
    )
    assert "amber: all of all, with an error beyond it" in text


def test_a_yield_is_advised_where_its_curve_crosses_the_goal() -> None:
    falling = [(40.0, 0.99), (44.0, 0.98), (46.0, 0.90), (50.0, 0.1)]
    mu = "\u202f\u00b5m"
    said = yield_advice(falling, 0.94)  # half of the way from 44 to 46
    assert said.startswith(f"Stay below about 45{mu}:")
    rising = [(90 - x, p) for x, p in falling[::-1]]
    assert yield_advice(rising, 0.94).startswith(f"Stay above about 45{mu}:")
    both = [(0.0, 0.5), *[(x - 30, p) for x, p in falling]]
    assert yield_advice(both, 0.94).startswith(f"Stay within about 8.98{mu} to 15{mu}:")
    assert yield_advice(falling, 0.05) == "Any size on the curve gives the goal."


def test_a_choice_that_failed_in_trials_tells_what_a_run_does(
    folder: ReportedPlan,
) -> None:
    look = next(la for la in folder.looks if la.measure.fallback)
    assert "the choice gave no answer" not in _said(look)
    chosen = replace(look.evidence.chosen, trials=24, success=21, silent=1)
    worse = replace(look, evidence=replace(look.evidence, chosen=chosen))
    spare = " > ".join(use.id for use in look.measure.fallback)
    assert f"no answer in 2 of its 24 trials: a run then measures with {spare}" in (
        _said(worse)
    )
    assert "in 1 of its 24 trials the choice answered wrongly" in _said(worse)
    alone = replace(worse, measure=replace(look.measure, fallback=()))
    assert "a run then looks again, which P(success) counts as time" in _said(alone)


def _said(look: Look) -> str:
    return " ".join(map(write, accuracy(look)))


def test_every_step_and_look_has_its_place(folder: ReportedPlan, page: Page) -> None:
    text = " ".join(page.text)
    for number, step in enumerate(folder.plan.steps, 1):
        assert f"{number}. {step.id}" in text
    maps = [t for t in page.of("table") if t.get("class") == "map"]
    assert len(maps) == len(folder.looks)
    radios = [i for i in page.of("input") if i["type"] == "radio"]
    assert len(radios) == 4 * len(folder.looks)
    assert sum("checked" in radio for radio in radios) == len(folder.looks)
    for look in folder.looks:
        for score in (look.evidence.chosen, *look.evidence.others):
            assert score.reason in text


def test_rows_link_to_places_in_the_picture(folder: ReportedPlan, page: Page) -> None:
    look = next(look for look in folder.looks if look.id == "over_shaft")
    names = [layer.name for layer in look.scene.layers]
    names += [f"={measure.feature or look.target}" for measure in look.measures]
    assert len(names) == 6
    places = {place_id(look, name) for name in names}
    assert places <= set(page.ids)
    assert places <= {a["href"][1:] for a in page.of("a")}


def test_a_part_called_script_stays_a_name(
    compiled_example: Path, tmp_path: Path
) -> None:
    copy = renamed(compiled_example, tmp_path, "gear", EVIL)
    found = read_folder(copy)
    assert any(look.target.startswith(EVIL) for look in found.looks)
    markup = plan_report(found)
    page = check_page(markup)
    assert EVIL not in markup
    assert EVIL in " ".join(page.text)


def test_an_infeasible_plan_tells_why(folder: ReportedPlan) -> None:
    plan = folder.plan
    reason = Reason(code="MP501", step="over_shaft", message="no routine finds it")
    steps = plan.steps[:7]
    short = replace(
        plan, status="infeasible", reasons=(reason,), steps=steps,
        success_probability=0.0,
    )  # fmt: skip
    text = " ".join(check_page(plan_report(replace(folder, plan=short))).text)
    assert "Infeasible" in text
    assert "ends before over_shaft" in text
    assert reason.message in text
    assert "no error budget" in text
    assert "Least room" in text
    assert "worst offenders" not in text  # nothing that was worked out offends
    assert "none needed" not in text


@pytest.mark.parametrize("steps", [0, 1])
def test_a_plan_that_ends_at_once_has_a_page(folder: ReportedPlan, steps: int) -> None:
    plan = folder.plan
    reason = Reason(code="MP401", step=plan.steps[steps].id, message="too uncertain")
    short = replace(
        plan, status="infeasible", reasons=(reason,), steps=plan.steps[:steps],
        success_probability=0.0,
    )  # fmt: skip
    text = " ".join(check_page(plan_report(replace(folder, plan=short))).text)
    assert f"ends before {reason.step}" in text
    assert ("Least room" in text) == bool(steps)


def test_a_budget_without_offenders_is_not_denied(folder: ReportedPlan) -> None:
    def bare(step: Step) -> Step:
        if step.budget.analysis is None:
            return step
        analysis = replace(step.budget.analysis, offenders=())
        return replace(step, budget=replace(step.budget, analysis=analysis))

    plan = replace(folder.plan, steps=tuple(map(bare, folder.plan.steps)))
    text = " ".join(check_page(plan_report(replace(folder, plan=plan))).text)
    assert "The error budget has no term" in text
    assert "so there is no error budget" not in text


def test_the_methods_tell_what_was_aimed_at_and_what_is_left(
    folder: ReportedPlan,
) -> None:
    said = write(methods(folder))
    assert f"each effect was to stay within {MAX_IMAGE_ERROR} of unit contrast" in said
    rows = [row for look in folder.looks for row in look.effects]
    left = max(r.predicted_error or 0 for r in rows if r.unit == "unit contrast")
    assert left > float(MAX_IMAGE_ERROR)
    assert f"up to {left:.2g} is left" in said
    loose = replace(folder.plan.provenance, max_image_error=left)
    found = methods(replace(folder, plan=replace(folder.plan, provenance=loose)))
    assert "and does where the effects ledgers give a number" in write(found)


def test_a_budget_that_falls_short_names_the_cheapest_change(
    folder: ReportedPlan,
) -> None:
    insert = next(s for s in folder.plan.steps if s.verb == "insert")
    analysis = insert.budget.analysis
    assert analysis is not None
    worst = replace(analysis.offenders[0], largest_um=0.1, size_um=0.5)
    hopeless = replace(analysis.offenders[1], largest_um=None)
    budget = replace(
        insert.budget,
        success_probability=0.5,
        analysis=replace(analysis, offenders=(worst, hopeless)),
    )
    plan = _with(folder.plan, insert.id, budget=budget)
    text = " ".join(check_page(plan_report(replace(folder, plan=plan))).text)
    assert "bring it from 0.5\u202f\u00b5m to 0.1\u202f\u00b5m or less" in text
    assert "no size of this term alone gives the goal" in text


def _with(plan: Plan, name: str, **changes: object) -> Plan:
    steps = (
        replace(s, **changes) if s.id == name else s  # type: ignore[arg-type]
        for s in plan.steps
    )
    return replace(plan, steps=tuple(steps))


def test_a_step_below_its_share_of_a_goal_that_is_met_needs_no_change(
    folder: ReportedPlan,
) -> None:
    insert = next(s for s in folder.plan.steps if s.verb == "insert")
    analysis = insert.budget.analysis
    assert analysis is not None
    change = Change(what="widen the hole", halvings=0.1, success_probability=0.999)
    term = replace(analysis.offenders[0], largest_um=0.1, size_um=0.5)
    short = replace(
        analysis, required_probability=0.999, miss_probability=0.01,
        changes=(change,), offenders=(term,),
    )  # fmt: skip
    budget = replace(insert.budget, success_probability=0.99, analysis=short)
    met = replace(folder.plan, success_goal=0.9, success_probability=0.99 * 0.95)
    plan = _with(met, insert.id, budget=budget)
    text = " ".join(check_page(plan_report(replace(folder, plan=plan))).text)
    assert (
        "No change is needed: the goal is met. What would give insert its share" in text
    )
    assert "none needed; 0.1\u202f\u00b5m or less gives its share" in text
    (margin,) = (m for m in margins(plan) if m.subject == "chance that insert misses")
    assert margin.ratio == pytest.approx((1 - 0.9 / 0.95) / 0.01)
    failed = replace(plan, success_goal=0.96)  # by the others already
    (margin,) = (m for m in margins(failed) if m.subject == "chance that insert misses")
    assert margin.ratio == pytest.approx(0.001 / 0.01)


def test_plans_of_one_look_and_of_nothing_have_reports(folder: ReportedPlan) -> None:
    plan = folder.plan
    for steps in (plan.steps[:1], plan.steps[4:5], ()):
        check_page(plan_report(replace(folder, plan=replace(plan, steps=steps))))


@pytest.mark.parametrize("value", [0.0, 5e-324, 1e300, 1.7e308])
def test_odd_numbers_are_shown_as_they_are(folder: ReportedPlan, value: float) -> None:
    insert = next(s for s in folder.plan.steps if s.verb == "insert")
    before = next(s for s in folder.plan.steps if s.id == "over_shaft")
    (look,), analysis = before.looks, insert.budget.analysis
    assert analysis is not None
    rows = tuple(replace(row, sigma_um=value) for row in insert.budget.rows)
    flat = replace(analysis, covariance_um2=(0.0, 0.0, 0.0), miss_probability=0.0)
    budget = replace(insert.budget, rows=rows, limit_um=-value, analysis=flat)
    found = replace(
        look,
        view=replace(look.view, um_per_px=value, field_um=(value, value)),
        measure=replace(look.measure, usable_focus_um=(0.0, value)),
        evidence=replace(
            look.evidence,
            tolerance_um=value,
            chosen=replace(look.evidence.chosen, cost=value, sigma_um=value),
        ),
    )
    plan = _with(folder.plan, insert.id, budget=budget)
    plan = _with(plan, before.id, looks=(found,))
    markup = plan_report(replace(folder, plan=plan))
    check_page(markup)
    assert not re.search(r'[ "(,-](inf|nan)[ ",)]', re.sub('data:[^"]*', "", markup))


def test_a_plan_alone_has_a_report(compiled_example: Path, tmp_path: Path) -> None:
    alone = tmp_path / "plan.json"
    shutil.copyfile(compiled_example / "plan.json", alone)
    text = " ".join(check_page(plan_report(read_folder(alone))).text)
    assert "is not in the folder" in text


def test_an_image_of_another_plan_is_not_shown(
    compiled_example: Path, tmp_path: Path
) -> None:
    copy = Path(shutil.copytree(compiled_example, tmp_path / "copy.plan"))
    first, other = (look.scene.image for look in read_folder(copy).looks[:2])
    shutil.copyfile(copy / other, copy / first)
    found = read_folder(copy)
    assert first not in found.pictures
    assert other in found.pictures
    text = " ".join(check_page(plan_report(found)).text)
    assert f"{first} is not the image that this plan is of" in text


@pytest.mark.parametrize("name", ["../secret.png", "/etc/passwd", "images/none.png"])
def test_pictures_outside_the_folder_are_not_shown(
    folder: ReportedPlan, compiled_example: Path, tmp_path: Path, name: str
) -> None:
    shutil.copyfile(
        compiled_example / folder.looks[0].scene.image, tmp_path / "secret.png"
    )
    first = folder.plan.steps[0]
    look = first.looks[0]
    moved = replace(look, scene=replace(look.scene, image=name))
    plan = replace(folder.plan, steps=(replace(first, looks=(moved,)),))
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "plan.json").write_text(dump_plan(plan), encoding="utf-8")
    assert read_folder(inside).pictures == {}


def test_what_is_no_plan_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(tmp_path / "none")]) == 2
    assert "error[MP704]" in capsys.readouterr().err
    (tmp_path / "plan.json").write_text("{}", encoding="utf-8")
    assert main(["report", str(tmp_path)]) == 2


def test_a_report_that_cannot_be_written_is_told(
    compiled_example: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "report.html"
    assert main(["report", str(compiled_example), "-o", str(out)]) == 2
    assert "error[MP702]" in capsys.readouterr().err


def test_a_report_takes_the_place_of_a_report_alone(
    compiled_example: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.html"
    assert main(["report", str(compiled_example), "-o", str(page)]) == 0
    first = page.read_bytes()
    page.write_bytes(first + b"older")
    assert main(["report", str(compiled_example), "-o", str(page)]) == 0
    assert page.read_bytes() == first
    for text in ("microplan: 1\n", "<!doctype html>\n<html><title>mine</title>", ""):
        page.write_text(text)
        assert main(["report", str(compiled_example), "-o", str(page)]) == 2
        assert f"--> {page}" in capsys.readouterr().err
        assert page.read_text() == text


@pytest.mark.parametrize("out", [".", "/", "a folder", "n" * 300])
def test_a_report_in_an_impossible_place_leaves_nothing(
    compiled_example: Path, tmp_path: Path, out: str,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a folder").mkdir()
    assert main(["report", str(compiled_example), "-o", out]) == 2
    assert "error[MP702]" in capsys.readouterr().err
    assert [p.name for p in tmp_path.rglob("*")] == ["a folder"]


def test_margins_are_in_order_and_hold_in_a_feasible_plan(folder: ReportedPlan) -> None:
    found = margins(folder.plan)
    ratios = [m.ratio for m in found]
    assert ratios == sorted(ratios)
    assert min(ratios) >= 1
    assert {m.look for m in found if m.look} == {look.id for look in folder.looks}


def test_the_timeline_agrees_with_what_the_looks_wait_for(folder: ReportedPlan) -> None:
    found = {span.step: span for span in spans(folder.plan, folder.world)}
    for step in folder.plan.steps:
        waits = sum(
            look.verdict.change.total_s for look in step.looks
            if look.verdict is not None and look.verdict.change is not None
        )  # fmt: skip
        if step.looks and step.verb == "locate":
            assert found[step.id].total_s == pytest.approx(waits, abs=1e-5)
    # 260 um at 20 um/s, and the stage settles
    assert folder.world is not None
    expected = 260 / 20 + folder.world.stage.settle_s
    assert found["insert"].total_s == pytest.approx(expected)
    planned = planned_s(folder.plan, folder.world)
    assert planned["insert"] == pytest.approx(expected)
    stage = replace(folder.world.stage, speed_z_um_per_s=0.0)
    stuck = replace(folder.world, stage=stage)  # a damaged world: nothing is told
    assert "lift" not in planned_s(folder.plan, stuck)


def test_an_alignment_counts_its_first_look_once(folder: ReportedPlan) -> None:
    found = {span.step: span for span in spans(folder.plan, folder.world)}
    step = next(s for s in folder.plan.steps if s.id == "over_shaft")
    assert step.control is not None
    looks = step.control.expected_cycles
    # the robot comes back by 400 um at 5000 um/s and settles; each look, the first too,
    # after .15 s of settling, and by the second frame of 30 per s, as the one under way
    # when it stands is no good
    back = 400 / 5000 + 0.15
    whole = back + step.control.approach_s + looks * (0.15 + 2 / 30)
    assert found["over_shaft"].total_s == pytest.approx(whole, abs=1e-4)
    assert planned_s(folder.plan, folder.world)["over_shaft"] == pytest.approx(
        whole, abs=1e-4
    )


def test_a_verification_takes_its_sweep_too(folder: ReportedPlan) -> None:
    found = planned_s(folder.plan, folder.world)
    (step,) = (s for s in folder.plan.steps if isinstance(s.action, VerifyAction))
    assert isinstance(step.action, VerifyAction)
    assert step.action.height is not None
    stops = len(step.action.height.focus_um)
    # 1/30 s for the frame of two looks and of every stop, .4 s for the focus of all but
    # the first, which the alignment had; the sweep takes a second frame at either end
    whole = (1 + stops) * 0.4 + (2 + stops) / 30 + 2 / 30
    assert found[step.id] == pytest.approx(whole, abs=1e-4)


def test_what_no_time_is_known_of_is_named(folder: ReportedPlan, page: Page) -> None:
    plan, every = folder.plan, {step.id for step in folder.plan.steps}
    # where the robot stands after the alignment is measured
    unknown = {"find_gear", "grasp", "release", "retract"}
    assert set(planned_s(plan, folder.world)) == every - unknown
    told = "without probing moves of find_gear; jaws of grasp, release"
    assert told in " ".join(page.text)
    # without a world nobody knows how fast axes and focus are
    assert set(planned_s(plan, None)) == every - unknown - {
        "lift", "insert", "aside", "check_seated",
    }  # fmt: skip


def test_the_ellipse_holds_its_share_of_errors() -> None:
    covariance = np.array([[0.5, 0.2], [0.2, 0.3]])
    long, short, angle = ellipse((0.5, 0.2, 0.3))
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    back = turn @ np.diag([long**2, short**2]) @ turn.T
    np.testing.assert_allclose(back, covariance, atol=1e-12)
    draws = np.random.default_rng(1).multivariate_normal((0, 0), covariance, 100_000)
    radius = np.hypot(*(draws @ turn / (long, short)).T)
    for share in (0.68, 0.95):
        inside = float((radius < sigmas(share)).mean())
        assert inside == pytest.approx(share, abs=4 * math.sqrt(0.25 / 100_000))


def test_the_accuracy_figure_says_which_chains_had_fewer_trials(
    folder: ReportedPlan,
) -> None:
    look = next(look for step in folder.plan.steps for look in step.looks)
    told = "may have stopped after 8 of its 64 trials"
    assert told not in "".join(map(write, accuracy(look)))
    more = replace(look.evidence.chosen, trials=64, success=64)
    longer = replace(look, evidence=replace(look.evidence, chosen=more))
    assert told in "".join(map(write, accuracy(longer)))
