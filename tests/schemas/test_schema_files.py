"""The JSON Schemas are valid, strict, and named as they are loaded."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jsonschema
import pytest

from microplan.schemas.files import json_schema


def rules(node: Any) -> Iterator[dict[str, Any]]:
    """Yield every mapping of a schema."""
    if isinstance(node, dict):
        yield node
        for value in node.values():
            yield from rules(value)
    elif isinstance(node, list):
        for item in node:
            yield from rules(item)


@pytest.mark.parametrize("name", ["task", "workcell"])
def test_schemas_are_valid_and_leave_no_key_unchecked(name: str) -> None:
    schema = json_schema.load(name)
    jsonschema.Draft202012Validator.check_schema(schema)
    for rule in rules(schema):
        assert "oneOf" not in rule  # its errors name no key
        assert "anyOf" not in rule
        if rule.get("type") == "object" and "properties" in rule:
            assert rule["additionalProperties"] is not True
        if rule.get("type") in ("number", "integer"):
            assert "maximum" in rule  # absurd numbers are refused
            assert "minimum" in rule or "exclusiveMinimum" in rule


@pytest.mark.parametrize("name", ["task", "workcell"])
def test_defaults_obey_their_own_rule(name: str) -> None:
    schema = json_schema.load(name)
    validator = jsonschema.Draft202012Validator(schema)
    seen = 0
    for rule in rules(schema):
        if "default" in rule and not isinstance(rule["default"], dict):
            validator.evolve(schema={**rule, "$defs": schema["$defs"]}).validate(
                rule["default"]
            )
            seen += 1
    assert seen > 5


def test_an_unknown_format_is_refused() -> None:
    with pytest.raises(
        ValueError, match="name must be one of task, workcell, plan, station, outlines"
    ):
        json_schema.load("cell")


@pytest.mark.parametrize("name", ["task", "workcell"])
def test_every_key_is_explained(name: str) -> None:
    """What an editor shows beside a key: its own words, or what it refers to."""
    schema = json_schema.load(name)
    assert schema["title"]
    silent, told = [], 0
    for path, rule in keys(schema):
        meant = schema["$defs"].get(rule.get("$ref", "").rpartition("/")[2], {})
        says = rule.get("description") or meant.get("description", "")
        if len(says.split()) < 2:
            silent.append(path)
        told += 1
    assert silent == []
    assert told > 60


def keys(rule: Any, path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the rule of every key that a user may write, not what decides on them."""
    if isinstance(rule, list):
        for item in rule:
            yield from keys(item, path)
        return
    if not isinstance(rule, dict):
        return
    for name, inner in rule.get("properties", {}).items():
        yield f"{path}/{name}", inner
    for name, inner in rule.items():
        if name not in ("if", "then", "else"):
            yield from keys(inner, f"{path}/{name}")
