"""Every key of plan and world is described, and by its own comment."""

from __future__ import annotations

import dataclasses
from types import ModuleType
from typing import Any

import pytest

from microplan.schemas import pose
from microplan.schemas.files import json_schema, world
from microplan.schemas.files.plan_schema import field_notes
from microplan.schemas.plan import (
    actions,
    document,
    evidence,
    looks,
    measures,
    steps,
    verdicts,
    views,
)

PLAN = (actions, document, evidence, looks, measures, steps)


def types_of(module: ModuleType) -> list[type]:
    """Return the dataclasses that a module defines."""
    return [
        value
        for value in vars(module).values()
        if dataclasses.is_dataclass(value)
        and isinstance(value, type)
        and value.__module__ == module.__name__
    ]


@pytest.mark.parametrize("module", [*PLAN, pose, verdicts, views, world])
def test_every_field_has_a_comment(module: ModuleType) -> None:
    found = types_of(module)
    assert found
    for kind in found:
        assert set(field_notes(kind)) == {f.name for f in dataclasses.fields(kind)}


@dataclasses.dataclass
class Sample:
    """Fields with comments in every place."""

    beside: int  # one line
    # above, on
    # two lines
    above: float = 0.0
    silent: str = ""
    wide: tuple[
        int, ...  # inside brackets
    ] = ()


def test_a_comment_belongs_to_the_field_beside_or_below_it() -> None:
    notes = field_notes(Sample)
    assert notes["beside"] == "one line"
    assert notes["above"] == "above, on two lines"
    assert "silent" not in notes
    assert notes["wide"] == "inside brackets"


def rules(node: Any, path: str) -> list[tuple[str, Any]]:
    """Return every key of a schema with its rule."""
    found = []
    if isinstance(node, dict):
        for key, rule in node.get("properties", {}).items():
            found += [(f"{path}.{key}", rule)]
        for key, inner in node.items():
            if key not in ("allOf", "if"):  # they repeat keys, to narrow them
                found += rules(inner, f"{path}.{key}")
    return found


@pytest.mark.parametrize("name", json_schema.NAMES)
def test_every_key_of_a_schema_says_what_it_means(name: str) -> None:
    found = rules(json_schema.load(name), name)
    assert len(found) > 30
    assert [path for path, rule in found if not rule.get("description")] == []
