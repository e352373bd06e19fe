"""What the comments beside a dataclass' fields say of them."""

from __future__ import annotations

import ast
import inspect
import io
import tokenize
from collections.abc import Mapping


def field_notes(kind: type) -> Mapping[str, str]:
    """Return name -> comment of the fields that have one, from the class' source.

    A field's comment ends its line; else it is the block of comment lines right above.

    Raises
    ------
    OSError
        If the source is not at hand.
    """
    source = inspect.getsource(kind)
    comments = _comments(source)
    lines = source.splitlines()
    (body,) = ast.parse(source).body
    found = {}
    for field in ast.walk(body):
        if not isinstance(field, ast.AnnAssign) or not isinstance(
            field.target, ast.Name
        ):
            continue
        last = field.end_lineno or field.lineno
        beside = [comments[n] for n in range(field.lineno, last + 1) if n in comments]
        text = " ".join(beside or _above(field.lineno, lines, comments))
        if text:
            found[field.target.id] = text
    return found


def _comments(source: str) -> dict[int, str]:
    """Return line number -> comment."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {
        token.start[0]: token.string.lstrip("# ")
        for token in tokens
        if token.type == tokenize.COMMENT
    }


def _above(number: int, lines: list[str], comments: Mapping[int, str]) -> list[str]:
    """Return the lines of the block of comments that ends above line `number`."""
    block: list[str] = []
    number -= 1
    while number in comments and lines[number - 1].lstrip().startswith("#"):
        block.insert(0, comments[number])
        number -= 1
    return block
