"""Elements of HTML or SVG, whose text is escaped when it is written.

There is no way to put markup in as text: a part that is called `<script>` stays a name.
What could run, or fetch anything, is refused.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TypeAlias, Union

Value: TypeAlias = str | int | float | bool | None
Node: TypeAlias = Union["Element", str, Iterable["Node"], None]

_VOID = frozenset({"br", "hr", "img", "input", "link", "meta", "wbr"})
_REFUSED = frozenset({"script", "iframe", "object", "embed", "form", "base"})
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(-[A-Za-z0-9]+)*")
_LOCAL = re.compile(r"#[A-Za-z][\w.-]*|data:image/(png|jpeg);base64,[\w+/=]*|data:,")
# control characters but tabs and line ends, those that turn text round, and those
# that nobody sees
_CONTROL = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b\u200e\u200f\u2028-\u202e"
    r"\u2060-\u206f\ud800-\udfff\ufeff\ufff9-\ufffb\U000e0000-\U000e007f]"
)


@dataclass(frozen=True, slots=True)
class Element:
    """One element; its attributes keep the order in which they were given."""

    name: str
    attributes: tuple[tuple[str, str], ...]
    children: tuple[Element | str, ...]


def el(name: str, /, *children: Node, **attributes: Value) -> Element:
    """Return an element.

    Parameters
    ----------
    name : str
        Such as "p".
    *children : Node
        Elements and text, also in lists; None is nothing.
    **attributes : str, number, bool or None
        A trailing underscore is dropped, others become hyphens: `class_`, `aria_label`.
        None and False leave an attribute out, True has no value, numbers get two
        decimals at most.

    Raises
    ------
    ValueError
        If the element or an attribute could run something, or point out of the page.
    """
    if name in _REFUSED or not _NAME.fullmatch(name):
        raise ValueError(f"no element <{name}> in a page")
    pairs = tuple(
        _attribute(key.rstrip("_").replace("_", "-"), value)
        for key, value in attributes.items()
        if value is not None and value is not False
    )
    return Element(name, pairs, tuple(_flat(children)))


def write(root: Element) -> str:
    """Return the markup of an element."""
    return "".join(_pieces(root))


def slug(*names: str) -> str:
    """Return an id for things with these names: other names give another id."""
    return ".".join(re.sub(r"[^A-Za-z0-9-]", _hex, name) for name in ("r", *names))


def visible(text: str) -> str:
    """Return text in which what a browser would hide or turn round is spelled out."""
    return _CONTROL.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def _hex(found: re.Match[str]) -> str:
    return f"_{ord(found[0]):x}_"


def _attribute(name: str, value: str | float) -> tuple[str, str]:
    """Return an attribute; what could run or fetch something is refused."""
    if not _NAME.fullmatch(name) or name.lower().startswith("on"):
        raise ValueError(f"no attribute {name!r} in a page")
    text = _text(value)
    if name in ("href", "src") and not _LOCAL.fullmatch(text):
        raise ValueError(f"{name} must stay in the page, got {text[:60]!r}")
    if "url(" in text.lower() or "expression(" in text.lower():
        text = text.replace("(", "\uff08")  # a name in a style fetches nothing
    return name, text


def _text(value: Value) -> str:
    """Return an attribute's value as text."""
    if value is True:
        return ""
    if isinstance(value, float):
        short = f"{value:.2f}".rstrip("0").rstrip(".")
        return "0" if short == "-0" else short
    return visible(str(value))


def _flat(children: Iterable[Node]) -> Iterator[Element | str]:
    """Yield elements and text, those in lists too."""
    for child in children:
        if child is None:
            continue
        if isinstance(child, Element | str):
            yield child
        else:
            yield from _flat(child)


def _pieces(node: Element | str) -> Iterator[str]:
    """Yield the markup of a node in pieces."""
    if isinstance(node, str):
        yield html.escape(visible(node), quote=False)
        return
    said = "".join(f' {k}="{html.escape(v)}"' for k, v in node.attributes)
    yield f"<{node.name}{said}>"
    if node.name in _VOID:
        return
    if node.name == "style":
        yield _css(node)
    else:
        for child in node.children:
            yield from _pieces(child)
    yield f"</{node.name}>"


def _css(node: Element) -> str:
    """Return a style sheet as it is; ValueError if it could end before its end."""
    text = "".join(child for child in node.children if isinstance(child, str))
    if "<" in text or "@import" in text or "url(" in text:
        raise ValueError("a style sheet holds no markup and fetches nothing")
    return text
