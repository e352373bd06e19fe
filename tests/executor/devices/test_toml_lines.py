"""Lines of a TOML file's keys: marked in the text itself, and for any valid data."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.executor.devices.toml_lines import key_lines, line_of

STATIONS = Path(__file__).parents[3] / "examples" / "stations"

TEXT = '''
a = 1
"b.c" = "# x = 1"
d . 'e' = {x = 1, y = {z = "}"}}
words = """
fake = 1
[fake] ""quotes"""""
plain = \'\'\'
fake = 2\'\'\'
rows = [
  [1, 2],
  # fake = 3
  [3, "]"],
]
[t]
k.l = 1979-05-27 07:32:00
[t.u."v w"]
m = -1e3
[[zooms]]
s = [{q = 1},
  {q = 2}]
[[zooms]]
s = 1
[zooms.inner]
'''
LINES = {
    "a": 2, "b.c": 3, "d": 4, "d.e": 4, "d.e.x": 4, "d.e.y": 4, "d.e.y.z": 4,
    "words": 5, "plain": 8, "rows": 10, "rows[0]": 11, "rows[0][0]": 11,
    "rows[0][1]": 11, "rows[1]": 13, "rows[1][0]": 13, "rows[1][1]": 13,
    "t": 15, "t.k": 16, "t.k.l": 16, "t.u": 17, "t.u.v w": 17, "t.u.v w.m": 18,
    "zooms": 19, "zooms[0]": 19, "zooms[0].s": 20, "zooms[0].s[0]": 20,
    "zooms[0].s[0].q": 20, "zooms[0].s[1]": 21, "zooms[0].s[1].q": 21, "zooms[1]": 22,
    "zooms[1].s": 23, "zooms[1].inner": 24,
}  # fmt: skip


def test_every_key_is_at_its_line() -> None:
    tomllib.loads(TEXT)
    assert key_lines(TEXT) == LINES


def paths(value: Any, at: str = "") -> set[str]:
    """Return the paths of all keys and entries of data."""
    found = {at} if at else set()
    if isinstance(value, dict):
        for key, inner in value.items():
            found |= paths(inner, f"{at}.{key}".strip("."))
    if isinstance(value, list):
        for number, inner in enumerate(value):
            found |= paths(inner, f"{at}[{number}]")
    return found


@pytest.mark.parametrize("name", ["simulated.toml", "micromanager_demo.toml"])
def test_all_keys_of_the_examples_are_found(name: str) -> None:
    text = (STATIONS / name).read_text(encoding="utf-8")
    lines = key_lines(text)
    assert set(lines) == paths(tomllib.loads(text))
    shown = text.splitlines()
    for key, line in lines.items():
        last = re.sub(r"(\[\d+\])+$", "", key).rpartition(".")[2]
        assert last in shown[line - 1] or "[" in key


TEXTS = st.text(alphabet="ab \"'#[]{}=.,\\\n", max_size=8)
DATA = st.recursive(
    st.integers(0, 9) | st.booleans() | TEXTS,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text("abc", min_size=1, max_size=2), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(st.dictionaries(st.text("abc", min_size=1, max_size=2), DATA, max_size=4))
def test_data_of_any_shape_are_found_line_by_line(data: dict[str, Any]) -> None:
    def inline(value: Any) -> str:
        if isinstance(value, dict):
            pairs = (f"{json.dumps(k)} = {inline(v)}" for k, v in value.items())
            inner = ", ".join(pairs)
            return "{" + inner + "}"
        if isinstance(value, list):
            return "[" + ",\n".join(map(inline, value)) + "]"
        return json.dumps(value)

    text, firsts = "", {}
    for key, value in data.items():
        firsts[key] = text.count("\n") + 1
        text += f"{key} = {inline(value)}\n"
    assert tomllib.loads(text) == data
    lines = key_lines(text)
    assert set(lines) == paths(data)
    assert {key: lines[key] for key in data} == firsts


def test_a_missing_key_is_at_what_holds_it() -> None:
    lines = key_lines("[a]\nb = [{c = 1}]\n")
    assert line_of(lines, "a.b[0].d") == 2
    assert line_of(lines, "a.c") == 1
    assert line_of(lines, "z.c") == 0
