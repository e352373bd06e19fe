"""YAML with positions: scalars of YAML 1.2 core, and where everything stands."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from microplan.planner.source.diagnostics import Report
from microplan.planner.source.source import Source, parse


def read(text: str) -> tuple[Source | None, Report]:
    """Return the source of `text` and the findings."""
    report = Report()
    return parse(text, Path("t.yaml"), "t.yaml", report), report


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-6", 1e-6),
        ("1E+3", 1000.0),
        ("-.5", -0.5),
        ("+12", 12),
        ("017", 17),
        ("0o17", 15),
        ("0x1F", 31),
        ("1_000", "1_000"),
        ("no", "no"),
        ("on", "on"),
        ("Yes", "Yes"),
        ("12:30", "12:30"),
        ("2024-01-31", "2024-01-31"),
        ("true", True),
        ("FALSE", False),
        ("~", None),
        ("", None),
        ("'12'", "12"),
        ('"true"', "true"),
        ("=", "="),
        ("nan", "nan"),
        ("1.5.2", "1.5.2"),
    ],
)
def test_plain_scalars_follow_yaml_1_2(text: str, value: object) -> None:
    source, report = read(f"a: {text}\n")
    assert report.found == []
    assert source is not None
    assert source.data == {"a": value}
    assert type(source.data["a"]) is type(value)


# what is no YAML: where, what is said, how it is mended
NO_YAML = (
    ("a: 1\ngoal\nb: 2\n", 2, 1, "'goal' has no colon", "write 'goal: ...'"),
    ("a: 1\nb:2\nc: 3\n", 2, 1, "'b:2' has no space after", "write 'b: 2'"),
    ("a:1\nb: 2\n", 2, 2, "the line above, 'a:1'", "write 'key: value'"),
    ('a: 1\nb: "x\nc: 2\n', 2, 4, 'the quote " that begins here', 'with "'),
    ("a: 'x\nb: 2\n", 1, 4, "the quote ' that begins here", "with '"),
    ("a:\n\tb: 1\n", 2, 1, "a tab", "use spaces"),
    ("a:\n  b: 1\n\tc: 2\n", 3, 1, "a tab", "use spaces"),
    ("a: b: c\n", 1, 5, "a second ': '", "quote text"),
    ("a: 1\n  b: 2\n", 2, 4, "has a value already", "indent"),
    ("a: @x\n", 1, 4, "cannot begin with '@'", "quotes"),
    ("a: *\n", 1, 4, "cannot begin with '*'", "quotes"),
    ('a: "parts\\gear.dxf"\n', 1, 11, "'\\g' means nothing", "single quotes"),
    ('a: "\\xzz"\n', 1, 7, "a broken \\ sequence", "single quotes"),
    ('a: "don\\\'t"\n', 1, 9, "'\\'' means nothing", "single quotes"),
    ("a: 1\n%b: 2\n", 2, 1, "cannot begin with '%'", "quotes"),
    ("a: !b! c\n", 1, 4, "cannot begin with '!'", "quotes"),
    ("  a: 1\nb: 2\n", 2, 1, "'b: 2' does not go on with", "in the same column"),
    ("{a: 1}\nb: 2\n", 2, 1, "'b: 2' does not go on with", "in the same column"),
    ("a: - b\n", 1, 4, "a list entry '- '", "[a, b]"),
    ("a:\n    b: 1\n  c: 2\n", 3, 3, "a key indented by 2", "alike"),
    ("a:\n  b: 2\n  - 1\n", 3, 3, "a list entry among keys", "a key of its own"),
    ("a:\n  - 1\n  b: 2\n", 3, 3, "a key among list entries", "a key of its own"),
    ("a: {b: 1\n", 1, 4, "the bracket { that opens here", "close it with }"),
    ("a: [1, 2\n", 1, 4, "the bracket [ that opens here", "close it with ]"),
    ("a: {b: 1\nc: 2\n", 2, 2, "in the { of line 1", "close it with }"),
    ("a: {b: 1 c: 2}\n", 1, 11, "',' or '}' must come before this key", "comma"),
    ("a: [1, 2}\n", 1, 9, "must come before '}', in the [ of", "close it with ]"),
    ("a: {b: 1}}\n", 1, 10, "'}' closes nothing", "remove it"),
    ("a: {b: 1} x\n", 1, 11, "'x' stands behind a value", "remove it"),
    ('a: "<gear>".bore\n', 1, 12, "'.bore' goes on behind the closing", "a part.feat"),
    ('a: {b: "<gear>".bore, c: 1}\n', 1, 16, "'.bore' goes on", "quote all of it"),
    ("a: [,]\n", 1, 5, "',' where a value must stand", "write the value"),
    ("a: [1,\n", 2, 1, "the file ends inside brackets", "close them"),
    ("a: >b\n", 1, 4, "'>' begins a text of several lines", "quotes"),
    # in the parser's own words
    ("a: ? b\n", 1, 4, "mapping keys are not allowed here", ""),
)


@pytest.mark.parametrize(("text", "line", "column", "says", "hint"), NO_YAML)
def test_what_is_no_yaml_is_told_in_plain_words(
    text: str, line: int, column: int, says: str, hint: str
) -> None:
    source, report = read(text)
    assert source is None
    (found,) = report.found
    assert (found.code, found.where.line, found.where.column) == ("MP003", line, column)
    assert found.message.startswith("not valid YAML: ")
    assert says in found.message
    assert hint in found.hint
    assert bool(found.hint) == bool(hint)


@pytest.mark.parametrize("text", [".nan", ".NaN", ".inf", "-.INF", "1e400", "9" * 400])
def test_numbers_that_are_not_finite_are_refused(text: str) -> None:
    source, report = read(f"a: {text}\nb: 2\n")
    assert [finding.code for finding in report.found] == ["MP008"]
    assert source is not None  # the rest is still read, to report all in one go
    assert source.faults == {("a",)}
    assert source.data["b"] == 2


def test_every_key_and_value_has_its_place() -> None:
    source, _ = read("a:\n  bc: 12  # no\n  d: [x, {e: yz}]\nf: 'g'\n")
    assert source is not None
    places = {
        ("a", "bc"): (2, 7, 2),
        ("a", "d"): (3, 6, 12),
        ("a", "d", 1): (3, 10, 7),
        ("a", "d", 1, "e"): (3, 14, 2),
        ("f",): (4, 4, 3),
    }
    for where, place in places.items():
        span = source.value(*where)
        assert (span.line, span.column, span.length) == place
    key = source.key("a", "bc")
    assert (key.line, key.column, key.length, key.text) == (2, 3, 2, "  bc: 12  # no")
    assert source.value("a", "d", 7, "none") == source.value("a", "d")


def test_columns_count_characters_and_lines_count_as_yaml_does() -> None:
    source, _ = read("ä: 1\r\nµm: [é, 2]\rc: 3\n")
    assert source is not None
    assert (source.value("µm", 1).line, source.value("µm", 1).column) == (2, 9)
    assert source.value("c").line == 3
    assert source.value("c").text == "c: 3"


def test_a_second_value_of_a_key_does_not_hide_further_mistakes() -> None:
    report = read("a: 1\na: .nan\nb: &x 2\n")[1]
    assert [finding.code for finding in report.found] == ["MP004", "MP008", "MP005"]
    assert "line 1" in report.found[0].message


letters = st.text(st.characters(categories=("L", "N", "P", "S")), max_size=9)
scalars = (
    st.none()
    | st.booleans()
    | st.integers(-(10**14), 10**14)
    | st.floats(allow_nan=False, allow_infinity=False)
    | letters
)
trees = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(letters, inner, max_size=4)
    ),
    max_leaves=12,
)


@settings(max_examples=60, deadline=None)
@given(data=st.dictionaries(letters, trees, min_size=1))
def test_json_is_read_as_what_it_says(data: dict[str, object]) -> None:
    source, report = read(json.dumps(data, ensure_ascii=False))
    assert report.found == []
    assert source is not None
    assert source.data == data


def test_a_file_of_too_many_values_is_refused() -> None:
    report = read("a: [" + "1," * 60000 + "]")[1]
    assert [finding.code for finding in report.found] == ["MP009"]


@settings(max_examples=150, deadline=None)
@given(text=st.text(st.sampled_from("ab:-[]{}&*!|>'\"%@#?,\n 0.e\t~<="), max_size=60))
def test_no_text_breaks_the_reader(text: str) -> None:
    source, report = read(text)
    assert (source is None or bool(source.faults)) == report.failed
    assert all(
        finding.where.line > 0 or finding.code == "MP011" for finding in report.found
    )
