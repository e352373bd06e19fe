"""The plan's schema agrees with the plan's types."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from microplan import schemas
from microplan.schemas.files import json_schema
from microplan.schemas.files.plan_schema import (
    outlines_schema,
    plan_schema,
    schema_text,
)
from microplan.schemas.plan import parse_plan

GOLDEN = Path(__file__).parents[2] / "golden" / "gear_on_shaft.fast.json"


def errors(data: Any) -> list[str]:
    """Return the paths at which the schema finds fault with a plan."""
    validator = jsonschema.Draft202012Validator(json_schema.load("plan"))
    return [error.json_path for error in validator.iter_errors(data)]


@pytest.fixture
def plan() -> Any:
    """Return a plan's data, free to be spoilt."""
    return copy.deepcopy(json.loads(GOLDEN.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    ("name", "schema"), [("plan", plan_schema()), ("outlines", outlines_schema())]
)
def test_the_file_is_what_the_types_say(name: str, schema: Any) -> None:
    file = Path(schemas.__file__).with_name(f"{name}.schema.json")
    assert file.read_text(encoding="utf-8") == schema_text(schema), (
        "run: python -m microplan.schemas.files.plan_schema"
    )
    assert json_schema.load(name) == schema


def test_the_schema_is_valid_and_closed() -> None:
    schema = json_schema.load("plan")
    jsonschema.Draft202012Validator.check_schema(schema)
    objects = [schema, *schema["$defs"].values()]
    assert len(objects) > 30
    assert all(rule["additionalProperties"] is False for rule in objects)
    assert "oneOf" not in schema_text(schema)
    assert "anyOf" not in schema_text(schema)


def test_a_compiled_plan_fits(plan: Any) -> None:
    assert errors(plan) == []


@pytest.mark.parametrize(
    ("path", "value", "where"),
    [
        (("status",), "perhaps", "$.status"),
        (("format_version",), "3.0", "$.format_version"),
        (("steps", 0, "action", "kind"), "grip", "$.steps[0].action.kind"),
        (("steps", 0, "action", "look"), 7, "$.steps[0].action.look"),
        (("steps", 2, "control", "gain"), None, "$.steps[2].control.gain"),
        (("steps", 0, "looks", 0, "view", "field_um"), [1.0],
         "$.steps[0].looks[0].view.field_um"),
        (("robot_start", "axes"), "arm", "$.robot_start.axes"),
        (("requirements", "travel", "stage.x_um"), [0.0, "far"],
         "$.requirements.travel['stage.x_um'][1]"),
        (("extra",), 1, "$"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named(
    plan: Any, path: tuple[str | int, ...], value: Any, where: str
) -> None:
    node = plan
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    assert errors(plan) == [where]


def test_a_missing_key_is_named_and_null_is_allowed_where_it_means_something(
    plan: Any,
) -> None:
    plan["robot_start"] = None
    plan["opening_start_um"] = None
    plan["steps"][0]["control"] = None
    assert errors(plan) == []
    del plan["steps"][1]["looks"][0]["measure"]["gates"]
    assert errors(plan) == ["$.steps[1].looks[0].measure"]


def test_an_older_plan_is_read_as_one_whose_views_are_unknown(plan: Any) -> None:
    plan["format_version"] = "2.1"
    for look in (look for step in plan["steps"] for look in step["looks"]):
        look.pop("verdict", None)
        look.pop("coarse", None)
    assert errors(plan) == []
    found = parse_plan(json.dumps(plan))
    looks = [look for step in found.steps for look in step.looks]
    assert looks
    assert all(look.verdict is None and look.coarse is None for look in looks)
