"""Pages of HTML: frame, figures, tables, facts, links."""

from __future__ import annotations

import base64
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from microplan.schemas.page.elements import Element, Node, el, write
from microplan.schemas.page.style import STYLE

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
_PNG = b"\x89PNG\r\n\x1a\n"


def document(title: str, *body: Node) -> str:
    """Return a whole page, which fetches nothing and runs nothing."""
    head = el(
        "head",
        el("meta", charset="utf-8"),
        Element(
            "meta",
            (("http-equiv", "Content-Security-Policy"), ("content", _POLICY)),
            (),
        ),
        el("meta", name="viewport", content="width=device-width, initial-scale=1"),
        el("meta", name="color-scheme", content="light dark"),
        el("title", title),
        el("link", rel="icon", href="data:,"),
        el("style", STYLE),
    )
    skip = el("a", "Skip to the verdict", class_="skip", href="#verdict")
    root = el("html", head, el("body", skip, body), lang="en")
    return "<!doctype html>\n" + write(root) + "\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class Caption:
    """The caption of a figure: a title and three sentences."""

    title: str
    shows: str
    judge: str  # what good and bad look like
    do: Node  # what to do


def figure(caption: Caption, *content: Node) -> Element:
    """Return a figure with its caption."""
    said = el(
        "figcaption",
        el("strong", caption.title),
        el("span", caption.shows, class_="shows"),
        " ",
        el("span", caption.judge, class_="judge"),
        " ",
        el("span", caption.do, class_="do"),
    )
    return el("figure", content, said)


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table."""

    name: str
    numeric: bool = False


Row = Sequence[Node]


def table(
    columns: Sequence[Column],
    rows: Sequence[Row],
    *,
    ids: Sequence[str] = (),
    label: str = "",
) -> Element:
    """Return a table whose first column heads the rows; on phones rows are stacked.

    Roles are said: to a browser, stacked cells are no cells any more. `ids` are
    of the rows, where something links to them.
    """
    head = el("tr", [_head(column) for column in columns], role="row")
    body = [
        el(
            "tr",
            [
                _cell(column, cell, first=not k)
                for k, (column, cell) in enumerate(zip(columns, row, strict=True))
            ],
            id=ids[n] if ids else None,
            role="row",
        )
        for n, row in enumerate(rows)
    ]
    content = el(
        "table",
        el("thead", head, role="rowgroup"),
        el("tbody", body, role="rowgroup"),
        class_="stack",
        role="table",
        aria_label=label or None,
    )
    return el("div", content, class_="wide")


def facts(pairs: Sequence[tuple[str, Node]]) -> Element:
    """Return names with their values."""
    return el(
        "dl",
        [el("div", el("dt", name), el("dd", value)) for name, value in pairs],
        class_="facts",
    )


def more(title: str, *content: Node) -> Element:
    """Return something long that is opened by a click."""
    return el("details", el("summary", title), content)


def link(text: str, target: str) -> Element:
    """Return a link to an id of the same page."""
    return el("a", text, href=f"#{target}")


def chart(
    title: str, description: str, *drawn: Node, width: float, height: float
) -> Element:
    """Return a drawing that says in words what it shows."""
    return el(
        "svg",
        el("title", title),
        el("desc", description),
        drawn,
        class_="chart",
        role="img",
        aria_label=f"{title}. {description}",
        viewBox=f"0 0 {width:g} {height:g}",
    )


def png_uri(data: bytes) -> str:
    """Return a PNG or JPEG file as an address in the page.

    Raises
    ------
    ValueError
        If it is neither.
    """
    kind = "png" if data.startswith(_PNG) else "jpeg"
    if kind == "jpeg" and not data.startswith(b"\xff\xd8"):
        raise ValueError("a picture is a PNG or a JPEG file")
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def png_size(data: bytes) -> tuple[int, int]:
    """Return width and height of a PNG file, px; ValueError if it is none."""
    if not data.startswith(_PNG) or len(data) < 24 or data[12:16] != b"IHDR":
        raise ValueError("not a PNG file")
    width, height = struct.unpack(">II", data[16:24])
    return width, height


def _head(column: Column) -> Element:
    kind = "n" if column.numeric else None
    return el("th", column.name, scope="col", class_=kind, role="columnheader")


def _cell(column: Column, cell: Node, *, first: bool) -> Element:
    kind = "n" if column.numeric else None
    if first:
        return el("th", cell, scope="row", class_=kind, role="rowheader")
    return el("td", cell, class_=kind, data_of=column.name, role="cell")
