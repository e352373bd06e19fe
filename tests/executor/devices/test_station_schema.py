"""The schema of station.toml says what the executor's reader of it allows."""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.station_file import read_station
from microplan.schemas.files import json_schema

STATIONS = Path(__file__).parents[3] / "examples" / "stations"
SCHEMA = json_schema.load("station")
# whose other keys are options, which their drivers know
OPEN = ("hubs", "devices")

Keys = tuple[str | int, ...]


class Anything:
    """A hub whose every attribute is a device with every method."""

    def __getattr__(self, name: str) -> Anything:
        return self


def example() -> dict[str, Any]:
    """Return the example of a station, with every key that may be left out."""
    data = tomllib.loads((STATIONS / "simulated.toml").read_text(encoding="utf-8"))
    data["hubs"]["cell"] = {"driver": f"{__name__}:Anything"}
    data["camera"]["latency_frames"] = 0
    for phase in ("approach", "servo", "insert", "retreat"):
        given = {"step_um": 5e4, "step_deg": 360.0, "speed_um_per_s": 5e4}
        data["safety"][phase] = given | data["safety"][phase]
    return data


def toml(data: dict[str, Any]) -> str:
    """Return data as TOML; JSON's inline forms are TOML's but for `:` and names."""

    def inline(value: Any) -> str:
        if isinstance(value, dict):
            pairs = (f"{json.dumps(k)} = {inline(v)}" for k, v in value.items())
            return "{" + ", ".join(pairs) + "}"
        if isinstance(value, list):
            return "[" + ", ".join(map(inline, value)) + "]"
        return json.dumps(value)

    return "\n".join(f"{key} = {inline(value)}" for key, value in data.items())


def said(data: dict[str, Any], folder: Path) -> str:
    """Return what the reader complains of, or else all that it has read."""
    path = folder / "station.toml"
    path.write_text(toml(data), encoding="utf-8")
    try:
        found = read_station(path, folder)
    except ExecutorError as error:
        return f"{error.code}: {str(error).removeprefix(f'{path}: ')}"
    shown = found.station.offer, found.station.rules
    return f"read: {shown}"


def rule_of(rule: dict[str, Any]) -> dict[str, Any]:
    """Return a rule with what it refers to."""
    if "$ref" in rule:
        return {**SCHEMA["$defs"][rule["$ref"].rpartition("/")[2]], **rule}
    return rule


def tables(rule: dict[str, Any], at: Keys = ()) -> Iterator[tuple[Keys, Any]]:
    """Yield the closed tables of the format: their place and rule."""
    rule = rule_of(rule)
    kind = rule.get("type")
    if kind == "array":
        yield from tables(rule["items"], (*at, 0))
    elif kind == "object":
        yield at, rule
        for name, inner in rule["properties"].items():
            if name not in OPEN:
                yield from tables(inner, (*at, name))


TABLES = dict(tables(SCHEMA))
KEYS = [
    (*at, name)
    for at, rule in TABLES.items()
    for name in rule["properties"]
    if name != "hubs"  # the example's devices need it
]


def parent(data: Any, at: Keys) -> Any:
    """Return the table at a place."""
    for key in at:
        data = data[key]
    return data


@pytest.mark.parametrize("name", ["simulated.toml", "micromanager_demo.toml"])
def test_the_examples_fit(name: str) -> None:
    data = tomllib.loads((STATIONS / name).read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    validator = jsonschema.Draft202012Validator(SCHEMA)
    assert [error.json_path for error in validator.iter_errors(data)] == []


@pytest.mark.parametrize("at", TABLES, ids=str)
def test_the_reader_knows_the_same_keys(at: Keys, tmp_path: Path) -> None:
    data = example()
    parent(data, at)["strange"] = 1
    known = re.search(
        r"^MP812: .*strange: no such key.*; allowed: (.*)", said(data, tmp_path)
    )
    assert known is not None
    assert set(known[1].split(", ")) == set(TABLES[at]["properties"])


@pytest.mark.parametrize("at", KEYS, ids=str)
def test_the_reader_needs_the_same_keys(at: Keys, tmp_path: Path) -> None:
    data = example()
    *above, name = at
    table = TABLES[tuple(above)]
    usual = said(data, tmp_path)
    assert usual.startswith("read: ")
    del parent(data, tuple(above))[name]
    without = said(data, tmp_path)
    if name in table.get("required", ()) or name in ("robot", "jaws"):
        assert without.startswith("MP812: ")
        assert str(name) in without.partition(";")[0]
        return
    rule = table["properties"][name]
    if "default" in rule:
        with_default = copy.deepcopy(data)
        parent(with_default, tuple(above))[name] = rule["default"]
        told = said(with_default, tmp_path)
        # an angle's default is shown with three digits
        assert re.sub(r"window_rad=[^,]*", "", without) == re.sub(
            r"window_rad=[^,]*", "", told
        )
    assert without.startswith("read: ")


MOST = [
    ((*at, name), rule["maximum"])
    for at, table in TABLES.items()
    for name, rule in table["properties"].items()
    if "maximum" in rule
]


@pytest.mark.parametrize(("at", "most"), MOST, ids=str)
def test_the_reader_allows_as_much(at: Keys, most: float, tmp_path: Path) -> None:
    data = example()
    *above, name = at
    parent(data, tuple(above))[name] = most
    assert said(data, tmp_path).startswith("read: ")
    parent(data, tuple(above))[name] = most * 1.001
    assert f"{name}: found" in said(data, tmp_path)
