"""Plans as JSON text, and which versions of it are understood."""

from __future__ import annotations

import json
from typing import Any

from microplan.schemas import version
from microplan.schemas.codec import CodecError, from_data, to_data
from microplan.schemas.plan.document import FORMAT_VERSION, Plan


def dump_plan(plan: Plan) -> str:
    """Return the plan as JSON: two-space indent, LF, a final newline."""
    return json.dumps(to_data(plan), indent=2, ensure_ascii=False) + "\n"


def parse_plan(text: str) -> Plan:
    """Return the plan that `text` holds.

    Raises
    ------
    CodecError
        If it is not JSON, of a newer major version, or does not fit the types.
    """
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise CodecError(f"not JSON: {error}") from error
    check_version(data)
    return from_data(Plan, data)


def newer_note(plan: Plan) -> str:
    """Return that a plan is of a newer minor version than its reader, "" if not."""
    if not version.is_newer(plan.format_version, FORMAT_VERSION):
        return ""
    return (
        f"the plan is of format {plan.format_version}, this microplan knows "
        f"{FORMAT_VERSION}: what is new in it is passed over"
    )


def check_version(data: Any) -> None:
    """Raise CodecError unless `data` are of a version this reader understands."""
    stated = data.get("format_version") if isinstance(data, dict) else None
    try:
        version.check(stated, FORMAT_VERSION)
    except version.VersionError as error:
        raise CodecError(f"format_version {error}") from error
