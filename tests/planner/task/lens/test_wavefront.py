"""Wavefront errors as the workcell states them, and findings where they disagree."""

from __future__ import annotations

from pathlib import Path

import pytest

from microplan.planner.task.workcell import WavefrontSpec, ZernikeTerm
from tests.planner.task.light.test_check_light import loaded

PLAIN = "  wavelength_um: 0.6"


def stated(text: str) -> dict[str, str]:
    """Return a change of the workcell that states more of the objective."""
    return {PLAIN: f"  {text}\n{PLAIN}"}


def test_an_objective_has_no_wavefront_if_none_is_stated(tmp_path: Path) -> None:
    task, _ = loaded(tmp_path, {})
    assert task is not None
    assert task.workcell.optics.wavefront == WavefrontSpec()


def test_terms_are_read_by_their_index(tmp_path: Path) -> None:
    text = "wavefront: [{noll: 8, waves: -0.02, sigma_waves: 0.003}, "
    text += "{noll: 5, waves: 0.01}]"
    task, _ = loaded(tmp_path, stated(text))
    assert task is not None
    assert task.workcell.optics.wavefront.terms == (
        ZernikeTerm(noll=5, waves=0.01),
        ZernikeTerm(noll=8, waves=-0.02, sigma_waves=0.003),
    )


@pytest.mark.parametrize("rms", [0, 0.05, 0.25])
def test_the_total_may_be_all_that_is_known(tmp_path: Path, rms: float) -> None:
    task, _ = loaded(tmp_path, stated(f"wavefront_rms: {rms}"))
    assert task is not None
    assert task.workcell.optics.wavefront == WavefrontSpec(rms_waves=float(rms))


def test_no_terms_are_a_perfect_objective(tmp_path: Path) -> None:
    task, _ = loaded(tmp_path, stated("wavefront: []"))
    assert task is not None
    assert task.workcell.optics.wavefront.terms == ()


@pytest.mark.parametrize(
    ("text", "code", "at", "words"),
    [
        ("wavefront: [{noll: 4, waves: 0.1}]", "MP103", "4,", "at least 5, got 4"),
        ("wavefront: [{noll: 23, waves: 0.1}]", "MP103", "23,", "at most 22, got 23"),
        ("wavefront: [{noll: 7.5, waves: 0.1}]", "MP101", "7.5", "a whole number"),
        ("wavefront: [{noll: 8, waves: 0.3}]", "MP103", "0.3}", "at most 0.25"),
        ("wavefront: [{noll: 8, waves: -0.3}]", "MP103", "-0.3", "at least -0.25"),
        ("wavefront: [{noll: 8}]", "MP102", "{noll", "'waves' is missing"),
        ("wavefront: coma", "MP101", "coma", "must be a list"),
        ("wavefront_rms: 0.3", "MP103", "0.3", "at most 0.25"),
        ("wavefront_rms: -0.1", "MP103", "-0.1", "at least 0"),
        ("wavefront_rms: .nan", "MP", ".nan", ""),
        (
            "wavefront: [{noll: 8, waves: 0.1}, {noll: 8, waves: 0.2}]",
            "MP116", "8, waves: 0.2", "noll 8 is stated twice",
        ),
        (
            "wavefront: [{noll: 8, waves: 0.2}, {noll: 7, waves: 0.2}]",
            "MP116", "[{noll", "0.283 waves rms in all, above 0.25",
        ),
        (
            "wavefront: [{noll: 8, waves: 0.05, sigma_waves: 0.15}]",
            "MP116", "[{noll", "0.35 waves rms in all, above 0.25",
        ),
    ],
)  # fmt: skip
def test_nonsense_is_a_finding_where_it_stands(
    tmp_path: Path, text: str, code: str, at: str, words: str
) -> None:
    task, found = loaded(tmp_path, stated(text))
    assert task is None
    (finding,) = [each for each in found if each.severity == "error"]
    assert finding.code.startswith(code)
    assert words in finding.message
    assert finding.where.column == f"  {text}".index(at) + 1


def test_terms_and_total_contradict_each_other(tmp_path: Path) -> None:
    text = "wavefront_rms: 0.05\n  wavefront: [{noll: 8, waves: 0.01}]"
    task, found = loaded(tmp_path, stated(text))
    assert task is None
    (finding,) = [each for each in found if each.severity == "error"]
    assert finding.code == "MP116"
    assert "both stated" in finding.message
