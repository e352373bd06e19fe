"""What a plan folder keeps for reports is what the plan counted."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from microplan.planner.report.folder import ReportedPlan, read_folder
from microplan.schemas.page.page import png_size

LOOKS = 8


@pytest.fixture(scope="module")
def folder(compiled_example: Path) -> ReportedPlan:
    """Return the example's plan folder."""
    found = read_folder(compiled_example)
    assert len(found.looks) == len(found.evidence) == LOOKS
    return found


def test_the_trials_are_those_that_the_plan_counts(folder: ReportedPlan) -> None:
    for look in folder.looks:
        chosen, trials = look.evidence.chosen, folder.evidence[look.id].trials
        right = [t for t in trials if t.error_um is not None and not t.wrong]
        assert len(trials) == chosen.trials
        assert len(right) == chosen.success
        assert sum(t.wrong for t in trials) == chosen.silent
        errors = {t.trial: t.error_um for t in trials if t.error_um is not None}
        assert chosen.worst_um == pytest.approx(max(errors.values()), rel=1e-5)
        assert chosen.worst_trial is not None
        assert errors[chosen.worst_trial] == max(errors.values())


def test_the_ends_shown_are_those_of_the_usable_range(folder: ReportedPlan) -> None:
    for look in folder.looks:
        shown = folder.evidence[look.id].shown
        ends = [s.value for s in shown if s.what == "focus"]
        assert ends == [z for z in look.measure.usable_focus_um if z]
        ends = [s.value for s in shown if s.what == "magnification"]
        assert ends == [m for m in look.measure.usable_magnification if m != 1]
        worst = [s.value for s in shown if s.what == "worst"]
        assert worst == [look.evidence.chosen.worst_trial]
        size = (look.measure.region.columns, look.measure.region.rows)
        assert {png_size(folder.pictures[s.image]) for s in shown} == {size}


def test_features_and_bodies_are_where_the_plan_looks(folder: ReportedPlan) -> None:
    for look in folder.looks:
        found = folder.evidence[look.id]
        names = [measure.feature or look.target for measure in look.measures]
        assert [mark.name for mark in found.features] == names
        here, there = found.features[0].pose, look.measure.reference.pose
        assert math.dist((here.x_um, here.y_um), (there.x_um, there.y_um)) < 1e-6
        owners = {layer.name.partition(".")[0] for layer in look.scene.layers}
        assert owners <= set(found.places)
