"""`microplan diff`: what it says, and what it returns."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from microplan.planner.cli.main import main
from microplan.planner.diff.changes import KINDS
from tests.planner.diff.test_compare import TEXT, Data, look

CHANCE = f"{json.loads(TEXT)['success_probability']:.4f}"
LEFT_OUT = "; not in P(success): grasp (may slip)"
BOTH = f"P(success) {CHANCE} in both, feasible in both{LEFT_OUT}"


@pytest.fixture
def plans(tmp_path: Path) -> tuple[str, str]:
    """Return a plan folder, and another whose look repeats worse and is seen nearer."""
    data: Data = json.loads(TEXT)
    for name in ("old", "new"):
        (tmp_path / name).mkdir()
        text = json.dumps(data)
        (tmp_path / name / "plan.json").write_text(text, encoding="utf-8")
        look(data, "find_gear")["measure"]["sigma_xy_um"] = 0.5
        look(data, "find_gear")["view"]["magnification"] = 9.0
    return str(tmp_path / "old"), str(tmp_path / "new")


def test_the_same_plan_is_the_same(
    plans: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    old, _ = plans
    assert main(["diff", old, f"{old}/plan.json"]) == 0
    assert capsys.readouterr().out == f"the plans mean the same\n{BOTH}\n"


def test_differences_are_listed_by_kind(
    plans: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diff", *plans]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "2 differences: 1 choice, 1 prediction"
    assert lines[2:4] == [
        "choice",
        "  find_gear/looks/find_gear/view/magnification: 6.9 x became 9 x (+30.4 %)",
    ]
    assert lines[5] == "prediction"
    sigma_um = look(json.loads(TEXT), "find_gear")["measure"]["sigma_xy_um"]
    percent = 100 * (0.5 / sigma_um - 1)
    assert lines[6] == (
        "  find_gear/looks/find_gear/measure/sigma_xy_um: "
        f"{sigma_um:.6g} um became 0.5 um ({percent:+.3g} %), worse"
    )
    assert lines[7:] == ["", BOTH]


@pytest.mark.parametrize(
    ("words", "status"),
    [
        (("--fail-on", "feasibility"), 0), (("--fail-on", "choice"), 1),
        (("--fail-on", "worse"), 1), (("--fail-on", "inputs,effects"), 0),
        (("--fail-on", "all sorts"), 2), (("--tolerance", "sigma_xy_um=nan"), 2),
        (("--tolerance", "sigma_xy_um=99%", "--tolerance", "view=ignore"), 0),
        (("--tolerance", "sigma_xy_um=99%"), 1), (("--no-images", "--all"), 1),
    ],
)  # fmt: skip
def test_what_fails_is_the_users_to_say(
    plans: tuple[str, str], words: tuple[str, ...], status: int
) -> None:
    assert main(["diff", *plans, *words]) == status


@pytest.fixture
def stricter(tmp_path: Path) -> tuple[str, str]:
    """Return a plan, and one of a task that asks for better images and less success."""
    data: Data = json.loads(TEXT)
    for name in ("old", "new"):
        file = tmp_path / f"{name}.json"
        file.write_text(json.dumps(data), encoding="utf-8")
        data["provenance"] |= {"max_image_error": 0.001, "task_sha256": "0" * 64}
        data |= {"status": "infeasible", "success_probability": 0.7}
        look(data, "find_gear")["measure"]["sigma_xy_um"] = 0.5
        for step in data["steps"]:
            for row in (r for found in step["looks"] for r in found["effects"]):
                row["limit"] = 0.001 if row["limit"] == 0.002 else row["limit"]
    return str(tmp_path / "old.json"), str(tmp_path / "new.json")


def test_causes_stand_before_what_follows_and_alike_stands_together(
    stricter: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    count = TEXT.count('"limit": 0.002')
    assert count > 12
    assert main(["diff", *stricter]) == 1
    lines = capsys.readouterr().out.splitlines()
    heads = ["inputs", "feasibility", "prediction", "effects"]
    assert [line for line in lines if line in KINDS] == heads
    assert lines[3].startswith("  provenance/task_sha256: the task says something else")
    assert lines[4] == (
        "  provenance/max_image_error: 0.002 unit contrast became 0.001 unit contrast "
        "(-50 %)"
    )
    alike = lines[lines.index("effects") + 1 :]
    assert alike[0] == (
        f"  limit, {count} times: 0.002 unit contrast became 0.001 unit contrast "
        "(-50 %)"
    )
    assert alike[1].startswith("    find_gear/looks/find_gear/effects/")
    chances = f"P(success) {CHANCE} before, 0.7000 now"
    verdict = f"{chances}, feasible before, infeasible now{LEFT_OUT}"
    assert alike[3:] == ["", f"{count - 2} not listed; --all shows them", verdict]
    assert main(["diff", *stricter, "--all"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert sum(line.endswith("/limit") for line in lines) == count
    assert not [line for line in lines if "not listed" in line]


def test_a_stated_tolerance_stands_before_what_it_changes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As where a task asks for 2 um instead of 3: more looks, stricter limits."""
    data: Data = json.loads(TEXT)
    (tmp_path / "old.json").write_text(TEXT, encoding="utf-8")
    control = next(s for s in data["steps"] if s["id"] == "bring_between")["control"]
    control |= {"tolerance_xy_um": 2.0, "expected_cycles": 1.6}
    control["choice"]["options"][0] |= {"looks": 1.6, "expected_s": 0.35}
    effects = look(data, "bring_between")["effects"]
    strict = [row for row in effects if row["limit"] and row["unit"] == "nm"]
    assert len(strict) > 2
    for row in strict:
        row["limit"] = row["limit"] / 1.5
    (tmp_path / "new.json").write_text(json.dumps(data), encoding="utf-8")
    words = ["diff", str(tmp_path / "old.json"), str(tmp_path / "new.json")]
    assert main(words) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[2:4] == [
        "choice", "  bring_between/control/tolerance_xy_um: 3 um became 2 um (-33.3 %)",
    ]  # fmt: skip
    assert lines.index("prediction") < lines.index("effects")
    said = f"  limit, {len(strict)} times: 1500 nm became 1000 nm (-33.3 %)"
    assert lines[lines.index("effects") + 1] == said
    assert lines[-1] == BOTH


@pytest.fixture
def wider(tmp_path: Path) -> tuple[str, str]:
    """Return a plan, and one whose fit has less room and yields other sizes."""
    data: Data = json.loads(TEXT)
    (tmp_path / "old.json").write_text(TEXT, encoding="utf-8")
    insert = next(s for s in data["steps"] if s["id"] == "insert")
    insert["fit"]["clearance_um"] = [4.5, 6.0, 7.3]
    for row in insert["effects"]:
        row["predicted_error"] = 0.3 if row["effect"] == "wedging" else None
    for point in insert["budget"]["analysis"]["yields"][0]["points"]:
        point["value_um"] *= 1.1
        point["success_probability"] *= 0.5
    data["provenance"]["task_sha256"] = "0" * 64
    (tmp_path / "new.json").write_text(json.dumps(data), encoding="utf-8")
    return str(tmp_path / "old.json"), str(tmp_path / "new.json")


def test_entries_are_told_in_words_and_moved_curves_once(
    wider: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diff", *wider]) == 1
    lines = capsys.readouterr().out.splitlines()
    said = "clearance_um/0 (least): 4.6 um became 4.5 um (-2.17 %), worse"
    assert f"  insert/fit/{said}" in lines
    assert any("clearance_um/2 (most)" in line for line in lines)
    (told,) = [line for line in lines if "yields" in line]
    assert told.endswith(
        ": worked out for other sizes, so that its points do not compare"
    )
    assert not [line for line in lines if "points/" in line or "value_um" in line]
    # nine sizes, eight chances: the ninth is below what chances may differ by
    assert "17 not listed; --all shows them" in lines
    assert main(["diff", *wider, "--all"]) == 1
    whole = capsys.readouterr().out
    assert whole.count("points/8/value_um") == 1
    assert "not listed" not in whole
    assert main(["diff", *wider, "--format", "json"]) == 1
    told_all = json.loads(capsys.readouterr().out)["changes"]
    assert sum("/points/" in change["where"] for change in told_all) == 17


@pytest.mark.parametrize("form", ["github", "sarif"])
def test_findings_tell_causes_first(
    wider: tuple[str, str], capsys: pytest.CaptureFixture[str], form: str
) -> None:
    assert main(["diff", *wider, "--format", form]) == 1
    said = capsys.readouterr().out
    if form == "sarif":
        results = json.loads(said)["runs"][0]["results"]
        messages = [r["message"]["text"] for r in results]
        assert {r["level"] for r in results} == {"error"}  # any difference fails
    else:
        found = [line for line in said.splitlines() if line.startswith("::error ")]
        messages = [line.split("::", 2)[2] for line in found]
    ranks = [KINDS.index(text.split(":")[0]) for text in messages]
    assert len(ranks) > 20
    assert ranks == sorted(ranks)
    assert messages[-1].startswith("effects")


def test_json_tells_causes_first_too(
    stricter: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diff", *stricter, "--format", "json"]) == 1
    told = json.loads(capsys.readouterr().out)["changes"]
    ranks = [KINDS.index(change["kind"]) for change in told]
    assert ranks == sorted(ranks)
    limits = [c for c in told if c["where"].endswith("/limit")]
    assert {c["unit"] for c in limits} == {"unit contrast"}


def test_json_holds_every_change(
    plans: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diff", *plans, "--format", "json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["same"] is False
    first = said["changes"][0]
    assert (first["kind"], first["old"], first["new"]) == ("choice", 6.9, 9.0)
    assert [change["unit"] for change in said["changes"]] == ["x", "um"]
    assert said["verdicts"]["old"] == said["verdicts"]["new"]
    assert said["verdicts"]["new"]["status"] == "feasible"


def test_a_name_begins_no_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data: Data = json.loads(TEXT)
    look(data, "find_gear")["target"] = "a\n::error::b\r\u2028c"
    file = tmp_path / "odd.json"
    file.write_text(json.dumps(data), encoding="utf-8")
    golden = tmp_path / "plan.json"
    golden.write_text(TEXT, encoding="utf-8")
    assert main(["diff", str(golden), str(file)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[2] == "steps"
    assert lines[3].endswith("became a\\u000a::error::b\\u000d\\u2028c")
    assert lines[4:] == ["", BOTH]


@pytest.mark.parametrize("form", ["github", "sarif"])
def test_findings_tell_what_fails_and_what_got_worse(
    plans: tuple[str, str], capsys: pytest.CaptureFixture[str], form: str
) -> None:
    assert main(["diff", *plans, "--format", form, "--fail-on", "choice"]) == 1
    said = capsys.readouterr().out
    if form == "sarif":
        results = json.loads(said)["runs"][0]["results"]
        assert [r["level"] for r in results] == ["error", "warning"]
        assert {r["ruleId"] for r in results} == {"MP710"}
        assert [r["properties"]["severity"] for r in results] == [
            "different", "warning",
        ]  # fmt: skip
    else:
        assert [line.split(" ")[0] for line in said.splitlines()[:2]] == [
            "::error", "::warning",
        ]  # fmt: skip


@pytest.mark.parametrize(
    "content",
    [None, b"", b"\xff", b"[]", b"{}", b"[" * 100_000,
     TEXT.replace('"format_version": "2', '"format_version": "3').encode()],
)  # fmt: skip
def test_what_is_no_plan_is_said(
    plans: tuple[str, str], tmp_path: Path, content: bytes | None,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    file = tmp_path / "bad.json"
    if content is not None:
        file.write_bytes(content)
    for words in ([plans[0], str(file)], [str(file), plans[0]]):
        assert main(["diff", *words]) == 2
        heard = capsys.readouterr()
        assert heard.out == ""
        assert heard.err.startswith("error[MP704]")
        assert str(file) in heard.err


def test_a_newer_minor_plan_is_compared(plans: tuple[str, str], tmp_path: Path) -> None:
    """Unknown keys are passed over."""
    data: Data = json.loads(TEXT)
    data["format_version"] = "2.999"
    data["steps"][0]["unheard_of"] = 1
    file = tmp_path / "newer.json"
    file.write_text(json.dumps(data), encoding="utf-8")
    assert main(["diff", plans[0], str(file)]) == 0


def test_a_name_that_no_file_can_have_is_no_plan(
    plans: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diff", plans[0], "n" * 300]) == 2
    assert capsys.readouterr().err.startswith("error[MP704]")


@pytest.mark.parametrize(
    ("words", "allowed"),
    [(("--tolerance", "a=b"), "PATTERN=5%"), (("--fail-on", "sigma"), "feasibility")],
)
def test_a_wrong_argument_is_told_what_is_allowed(
    plans: tuple[str, str], words: tuple[str, ...], allowed: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    assert main(["diff", *plans, *words]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert words[1] in said
    assert allowed in said
