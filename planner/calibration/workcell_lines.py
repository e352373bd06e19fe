"""A workcell file's text with calibrated values put in; all else stays as it is."""

from __future__ import annotations

import math
from collections.abc import Sequence

import yaml

from microplan.planner.calibration.calibrated_value import CalibratedValue

_WIDTH = 110  # of a line


def with_calibrated(text: str, values: Sequence[CalibratedValue]) -> str:
    """Return a workcell's text with values put in, and what `calibrated` says of them.

    Parameters
    ----------
    text : str
        A valid workcell file; a section that it does not have is put at its end.
    values : sequence of CalibratedValue
        Values of no section are in the block alone; what is there of others stays.
    """
    for value in values:
        if value.where is not None:
            section, key = value.where
            text = _with_value(text, section, key, value.line)
    kept = yaml.safe_load(text).get("calibrated") or {}
    said = {**kept, **{value.key: value.record for value in values}}
    root = _root(text)
    if root.flow_style:  # as JSON is
        line = yaml.safe_dump(said, default_flow_style=True, width=math.inf)
        return _with_key(text, root, "calibrated", line.rstrip())
    block = yaml.safe_dump({"calibrated": said}, width=_WIDTH, sort_keys=False)
    return _with_block(text, block)


def _with_value(text: str, section: str, key: str, value: str) -> str:
    """Return the text with a key of a section set."""
    node, line = _mapping(text, section), f"{{{key}: {value}}}"
    if node is not None and node.value:
        return _with_key(text, node, key, value)
    if node is not None or _root(text).flow_style:
        return _with_key(text, _root(text), section, line)
    return f"{text.rstrip()}\n\n{section}: {line}\n"


def _mapping(text: str, key: str) -> yaml.MappingNode | None:
    """Return the node of a top-level mapping, None if there is none."""
    for name, value in _root(text).value:
        if name.value == key and isinstance(value, yaml.MappingNode):
            return value
    return None


def _root(text: str) -> yaml.MappingNode:
    """Return the node of a file."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    if not isinstance(root, yaml.MappingNode):
        raise ValueError("a workcell is a mapping")
    return root


def _with_key(text: str, node: yaml.MappingNode, key: str, value: str) -> str:
    """Return the text with a key of a mapping set."""
    for name, old in node.value:
        if name.value == key:
            end = _end(text, old)
            return text[: old.start_mark.index] + value + text[end:]
    first = node.value[0][0].start_mark
    line = f"{key}: {value}"
    if node.flow_style:
        return f"{text[: first.index]}{line}, {text[first.index :]}"
    indent = "\n" + " " * first.column
    return f"{text[: first.index]}{line}{indent}{text[first.index :]}"


def _with_block(text: str, block: str) -> str:
    """Return the text with a top-level block at its end, in place of an older one."""
    for name, old in _root(text).value:
        if name.value == "calibrated":
            start, end = name.start_mark.index, _end(text, old)
            return text[:start] + block.rstrip() + text[end:]
    return f"{text.rstrip()}\n\n{block}"


def _end(text: str, node: yaml.Node) -> int:
    """Return where a node's own text ends: block nodes reach to the next key."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(text, last[1] if isinstance(last, tuple) else last)
    return int(node.end_mark.index)
