"""Tables of a file format's keys, from its JSON Schema and files that use it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

Rule = Mapping[str, Any]
# keys from the top; NAME is any key but those behind it, [] any entry of a list
Place = tuple[str, ...]

HEADS = ("key", "type", "unit", "default", "range", "meaning", "example")
MOST_PLACES = 3  # of one table that are named
MOST_EXAMPLE = 40  # characters
UNITS = (  # the end of a key's name -> its unit; the longest ends first
    ("um_per_100um", "um per 100 um"), ("um_per_min", "um/min"),
    ("um_per_um", "um/um"), ("um_per_px", "um/px"), ("px_per_um", "px/um"),
    ("um_per_s", "um/s"), ("deg_per_s", "deg/s"), ("rad_per_s", "rad/s"),
    ("per_um", "1/um"), ("per_mm", "1/mm"), ("um2", "um^2"), ("arcsec", "arcsec"),
    ("mrad", "mrad"), ("gpa", "GPa"), ("deg", "deg"), ("rad", "rad"), ("um", "um"),
    ("nm", "nm"), ("px", "px"), ("ms", "ms"), ("hz", "Hz"), ("un", "uN"), ("s", "s"),
    ("e", "electrons"),
)  # fmt: skip
KINDS = {
    "number": "number", "integer": "whole number", "string": "text",
    "boolean": "true or false", "array": "list", "object": "table", "null": "null",
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """The keys of one table of a format, and where it may stand."""

    name: str
    rule: Rule
    about: str
    places: list[Place] = field(default_factory=list)


def key_tables(schema: Rule, samples: Sequence[Any]) -> str:
    """Return the chapters of a format: one a table, in the order of the schema.

    Examples are the first that stand in `samples`, else those of the schema.
    """
    found: dict[str, Table] = {}
    _collect(schema, schema, (), "", found)
    blocks = [_chapter(table, schema, samples) for table in found.values()]
    return "\n\n".join(blocks)


def cell(text: str) -> str:
    """Return text fit for a cell of a Markdown table."""
    text = text.replace("|", "\\|").replace("\n", " ")
    # outside of code a word behind < is a tag
    return "`".join(
        part if number % 2 else re.sub(r"<(?=\w)", r"\<", part)
        for number, part in enumerate(text.split("`"))
    )


def row(cells: Sequence[str]) -> str:
    """Return one line of a Markdown table."""
    return "| " + " | ".join(cell(text) for text in cells) + " |"


def _collect(
    rule: Rule, schema: Rule, place: Place, name: str, found: dict[str, Table]
) -> None:
    """Add every table below `place`; one that stands in several places once."""
    about = ""
    if "$ref" in rule:  # named by what it refers to, and described by that
        name = rule["$ref"].rpartition("/")[2]
        about = schema["$defs"][name].get("description", "")
    rule = _full(rule, schema)
    if "properties" in rule and not _is_union(rule):
        known = name in found
        about = about or (rule.get("description", "") if place else "")
        table = found.setdefault(name, Table(name=name, rule=rule, about=about))
        table.places.append(place)
        if known:
            return
    for part, inner in _below(rule):
        below = (*place, *part)
        _collect(inner, schema, below, f"/{_path(below)}", found)


def _below(rule: Rule) -> Iterator[tuple[Place, Rule]]:
    """Yield what is nested in a rule, and where."""
    if _is_union(rule):
        for case in rule["allOf"]:
            yield (), case["then"]
        return
    for key, inner in rule.get("properties", {}).items():
        yield (key,), inner
    if isinstance(rule.get("additionalProperties"), dict):
        others = " ".join(("NAME", *rule.get("properties", {})))
        yield (others,), rule["additionalProperties"]
    if isinstance(rule.get("items"), dict):
        yield ("[]",), rule["items"]
    if "then" in rule and "type" not in rule:  # null, or this
        yield (), rule["then"]


def _full(rule: Rule, schema: Rule) -> Rule:
    """Return a rule with what it refers to."""
    if "$ref" not in rule:
        return rule
    return {**schema["$defs"][rule["$ref"].rpartition("/")[2]], **rule}


def _is_union(rule: Rule) -> bool:
    """Return whether a rule is one of several tables, told apart by `kind`."""
    cases = rule.get("allOf", [])
    return bool(cases) and all("$ref" in case.get("then", {}) for case in cases)


def _chapter(table: Table, schema: Rule, samples: Sequence[Any]) -> str:
    """Return the heading, the keys and the rules between keys of one table."""
    lines = [f"## {_title(table)}", ""]
    classed = table.name[:1].isupper()
    also = [f"`{_path(place)}`" for place in table.places[0 if classed else 1 :]]
    where = ", ".join(also[:MOST_PLACES]) + " and others" * (len(also) > MOST_PLACES)
    said = [table.about.rstrip(".")] if table.about else []
    said += [("In " if classed else "Also ") + where] if where else []
    if said and table.places[0]:
        lines += [". ".join(text[:1].upper() + text[1:] for text in said) + ".", ""]
    needed, rows = table.rule.get("required", ()), []
    for key, rule in table.rule["properties"].items():
        samples_of = [(place, key) for place in table.places]
        rows.append(_key_row(key, rule, schema, key in needed, samples_of, samples))
    extra = table.rule.get("additionalProperties")
    if isinstance(extra, dict):
        inner = _full(extra, schema)
        text = f"any other: {inner.get('description', 'a table')}"
        rows.append(["*NAME*", "table", "", "-", "", text, ""])
    used = [k for k in range(len(HEADS)) if any(cells[k] for cells in rows)]
    lines += [row([HEADS[k] for k in used]), "|" + "---|" * len(used)]
    lines += [row([cells[k] for k in used]) for cells in rows]
    rules = [_condition(case) for case in _cases(table.rule)]
    return "\n".join(lines + ([""] + rules if rules else []))


def _title(table: Table) -> str:
    """Return what a table is called: where it stands, or the class it is written as."""
    if table.name[:1].isupper():
        return table.name
    return f"`{_path(table.places[0])}`" if table.places[0] else "The file"


def _path(place: Place) -> str:
    """Return a place as it is written: steps[].move[]."""
    shown = (key.partition(" ")[0] for key in place)
    return ".".join(shown).replace(".[]", "[]") or "the file"


def _key_row(
    key: str,
    rule: Rule,
    schema: Rule,
    needed: bool,  # noqa: FBT001 - a cell of the row
    places: Sequence[tuple[Place, str]],
    samples: Sequence[Any],
) -> list[str]:
    """Return the cells of one key, as `HEADS` has them."""
    full = _full(rule, schema)
    found = (_sample(data, (*at, name)) for data in samples for at, name in places)
    example = next((value for value in found if value is not None), None)
    if example is None:
        example = next(iter(full.get("examples", [])), None)
    if needed:
        default = "needed"
    else:
        default = _code(full["default"]) if "default" in full else "-"
    return [
        f"`{key}`",
        _kind(full, schema),
        _unit(key, full, schema),
        default,
        _range(full, schema),
        full.get("description", ""),
        "" if example is None else _code(example),
    ]


def _sample(data: Any, place: Place) -> Any:
    """Return the first value that stands at a place, None if there is none."""
    if not place:
        return None if data in ({}, []) else data
    key, rest = place[0], place[1:]
    inner: list[Any] = []
    if key == "[]" and isinstance(data, list):
        inner = data
    elif key.startswith("NAME") and isinstance(data, dict):
        named = key.split()[1:]  # which have rules of their own
        inner = [value for name, value in data.items() if name not in named]
    elif isinstance(data, dict) and key in data:
        inner = [data[key]]
    found = (_sample(value, rest) for value in inner)
    return next((value for value in found if value is not None), None)


def _code(value: Any) -> str:
    """Return a value as code, cut where it is long."""
    text = json.dumps(value, ensure_ascii=False)
    if len(text) > MOST_EXAMPLE:
        if isinstance(value, dict | list):
            return ""
        text = text[: MOST_EXAMPLE - 4] + '..."'
    return f"`{text}`"


def _kind(rule: Rule, schema: Rule) -> str:
    """Return what kind of value a key takes."""
    if "enum" in rule:
        return "one of"
    if "type" not in rule and "then" in rule:
        return _kind(_full(rule["then"], schema), schema) + " or null"
    kinds = rule.get("type", [])
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if kinds == ["object"] and isinstance(rule.get("additionalProperties"), dict):
        inner = _full(rule["additionalProperties"], schema)
        plural = _plural(_kind(inner, schema))
        return f"table of {plural}".replace("table of tables", "tables")
    if kinds == ["array"]:
        inner = rule["items"] if isinstance(rule.get("items"), dict) else None
        # of a whole number and another one the latter: both are numbers
        inner = inner or next(reversed(rule.get("prefixItems", [])), {})
        word = _kind(_full(inner, schema), schema)
        many = "names" if word == "one of" else _plural(word)
        count = _count(rule)
        return f"list of {many}" if count is None else f"{count} {many}"
    return " or ".join(KINDS[kind] for kind in kinds)


def _plural(word: str) -> str:
    if word[:1].isdigit():
        return f"{word} each"
    return f"lists{word[4:]}" if word.startswith("list") else f"{word}s"


def _unit(key: str, rule: Rule, schema: Rule) -> str:
    """Return the unit that a key's name ends with; 1 for a number without one."""
    text = json.dumps(rule) if "$ref" not in json.dumps(rule) else ""
    kind = _kind(rule, schema)
    if "number" not in kind and "list" not in kind and '"number"' not in text:
        return ""
    for end, unit in UNITS:
        if key == end or key.endswith("_" + end):
            return unit
    return "1" if kind.startswith("number") else ""


def _range(rule: Rule, schema: Rule) -> str:
    """Return what values are allowed."""
    if "enum" in rule:
        return ", ".join(f"`{value}`" for value in rule["enum"])
    if "items" in rule and isinstance(rule["items"], dict):
        inner = _range(_full(rule["items"], schema), schema)
        return "; ".join(text for text in (_entries(rule), inner) if text)
    if "pattern" in rule:
        if not rule["pattern"].startswith("^[A-Za-z_]"):
            return f"`{rule['pattern']}`"
        dotted = "\\." in rule["pattern"]
        return "a name" + (", or two with a dot" if dotted else "")
    low, high = "", ""
    if "minimum" in rule:
        low = f">= {rule['minimum']:.16g}"
    if "exclusiveMinimum" in rule:
        low = f"> {rule['exclusiveMinimum']:.16g}"
    if "maximum" in rule:
        high = f"<= {rule['maximum']:.16g}"
    return ", ".join(text for text in (low, high) if text)


def _count(rule: Rule) -> int | None:
    """Return how many entries a list has, None if it may have more or fewer."""
    if "prefixItems" in rule:
        return len(rule["prefixItems"])
    least, most = rule.get("minItems"), rule.get("maxItems")
    return least if least == most else None


def _entries(rule: Rule) -> str:
    """Return how many entries a list may have, "" where its type says so."""
    least, most = rule.get("minItems"), rule.get("maxItems")
    if _count(rule) is not None:
        return ""
    if most is not None:
        return f"{least or 0} to {most} entries"
    return ""


def _cases(rule: Rule) -> list[Rule]:
    """Return the rules between keys that a table has."""
    single = [rule] if "if" in rule else []
    return single + [case for case in rule.get("allOf", []) if "if" in case]


def _condition(case: Rule) -> str:
    """Return one rule between keys as a line of a list."""
    if "properties" in case["if"]:
        ((key, value),) = case["if"]["properties"].items()
        values = [value["const"]] if "const" in value else value["enum"]
        head = f"`{key}` is " + " or ".join(f"`{v}`" for v in values)
    else:
        head = " and ".join(f"`{key}`" for key in case["if"]["required"]) + " is given"
    said = [f"If {head}: {_consequence(case.get('then', {}))}"]
    if "else" in case:
        said.append(f"Else: {_consequence(case['else'])}")
    return "- " + ". ".join(said) + "."


def _consequence(rule: Rule) -> str:
    """Return what a rule between keys asks for."""
    said = []
    if "required" in rule:
        said.append("needed " + ", ".join(f"`{key}`" for key in rule["required"]))
    if "propertyNames" in rule:
        keys = rule["propertyNames"]["enum"]
        said.append("allowed " + ", ".join(f"`{key}`" for key in keys))
    return "; ".join(said)
