"""What holds of every page, without a browser: nesting, names, links, captions."""

from __future__ import annotations

import re
from html.parser import HTMLParser

VOID = {"br", "hr", "img", "input", "link", "meta", "wbr"}


class Page(HTMLParser):
    """A page taken apart, which refuses what is not properly nested."""

    def __init__(self, markup: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.ids: list[str] = []
        self.sentences: list[tuple[str, str]] = []  # class, text of a caption's part
        self.text: list[str] = []
        self._part: str | None = None
        self.feed(markup)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self.tags.append((tag, found))
        if "id" in found:
            self.ids.append(found["id"])
        if tag not in VOID:
            self.open.append(tag)
        if tag == "span" and found.get("class") in ("shows", "judge", "do"):
            self._part = found["class"]
            self.sentences.append((self._part, ""))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        if tag == "span":
            self._part = None

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.text.append(data)
        if self._part is not None:
            name, said = self.sentences[-1]
            self.sentences[-1] = (name, said + data)

    def of(self, *names: str) -> list[dict[str, str]]:
        """Return the attributes of all elements of these names."""
        return [found for tag, found in self.tags if tag in names]


def check_page(markup: str) -> Page:
    """Return a page that holds to the rules of all pages."""
    page = Page(markup)
    assert markup.startswith("<!doctype html>")
    assert page.of("html")[0]["lang"] == "en"
    assert len(page.ids) == len(set(page.ids)), "ids are unique"
    targets = {found["href"] for found in page.of("a", "use")}
    assert {t.removeprefix("#") for t in targets} <= set(page.ids), (
        "links lead somewhere"
    )
    assert not re.search(r"(?:https?:)?//[a-z]", re.sub(r"base64,[\w+/=]*", "", markup))
    assert "script" not in {tag for tag, _ in page.tags}
    assert all(found.get("alt") for found in page.of("img"))
    named = [s for s in page.of("svg") if s.get("role") == "img"]
    assert all(s["aria-label"] for s in named)
    assert all(found.get("scope") in ("row", "col") for found in page.of("th"))
    cells = [c for c in page.of("td") if "data-of" in c]
    assert all(c["role"] == "cell" for c in cells)
    assert len(page.of("h1")) == len(page.of("main")) == 1
    _captions(page)
    return page


def _captions(page: Page) -> None:
    """Hold every figure to its three sentences, one each."""
    figures = len(page.of("figure"))
    names = [name for name, _ in page.sentences]
    assert names == ["shows", "judge", "do"] * figures
    assert len(page.of("figcaption")) == figures
    for _, said in page.sentences:
        assert said.endswith("."), said
        assert not re.search(r"[a-z)]\. [A-Z]", said), f"one sentence each: {said}"
