"""JSON Schemas of the file formats, by name."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

NAMES = ("task", "workcell", "plan", "station", "outlines")


def load(name: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of the format called `name`.

    Raises
    ------
    ValueError
        If there is no format of that name.
    """
    if name not in NAMES:
        raise ValueError(f"name must be one of {', '.join(NAMES)}, got {name!r}")
    file = resources.files("microplan.schemas") / f"{name}.schema.json"
    schema: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return schema
