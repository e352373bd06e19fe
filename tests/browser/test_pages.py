"""Reports in a real browser: nothing fetched or said, readable, printable.

They run where there is a Chromium (Debian: apt-get install chromium). Without one they
are skipped, but never in CI.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from microplan.executor.analysis.run_report import write_report as write_run_report
from microplan.planner.report.report import write_report
from tests.browser.chromium import Chromium, find
from tests.names import renamed

BINARY = find()
NEEDED = 4.5  # contrast of text, WCAG 2.2, 1.4.3
LARGE = 3.0  # of text from 24 px on, or from 18.66 px if it is bold
PAGES = ("plan", "evil", "run")

# every text with its colour and what is behind it; pictures hold no text
CONTRASTS = """(() => {
  document.querySelectorAll('details').forEach(d => d.open = true);
  const parse = c => (c.match(/[\\d.]+/g) || [0, 0, 0, 0]).map(Number);
  const light = c => c.slice(0, 3).map(v => v / 255).map(v =>
    v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((s, v, k) => s + v * [0.2126, 0.7152, 0.0722][k], 0);
  const found = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const text = walk.currentNode.data.trim(), el = walk.currentNode.parentElement;
    const untold = /^(title|desc|style)$/i.test(el.tagName);
    if (!text || untold || !el.checkVisibility()) continue;
    const style = getComputedStyle(el);
    const fore = parse(el.ownerSVGElement ? style.fill : style.color);
    let back = [255, 255, 255], above = el;
    for (; above; above = above.parentElement) {
      const c = parse(getComputedStyle(above).backgroundColor);
      if (c.length < 4 || c[3] > 0) { back = c; break; }
    }
    const [a, b] = [light(fore), light(back)].sort((x, y) => y - x);
    const size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && style.fontWeight >= 700);
    found.push([(a + 0.05) / (b + 0.05), large, text.slice(0, 40)]);
  }
  return found;
})()"""
# what is wider than the page and is in nothing that scrolls by itself
WIDE = """[...document.querySelectorAll('body *')].filter(e =>
  e.getBoundingClientRect().right > innerWidth + 0.5 && e.checkVisibility() &&
  !e.closest('svg, .skip') && !e.closest('.wide')).map(e => e.outerHTML.slice(0, 80))"""


@pytest.fixture(scope="module")
def pages(
    compiled_example: Path, example_run: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Path]:
    """Return reports of the example, of one with an evil name, and of a run."""
    base = tmp_path_factory.mktemp("pages")
    evil = renamed(compiled_example, base, "gear", "<script>alert(1)</script>")
    run = Path(shutil.copytree(example_run, base / "run"))
    return {
        "plan": write_report(compiled_example, base / "plan.html"),
        "evil": write_report(evil, base / "evil.html"),
        "run": write_run_report(run),
    }


@pytest.fixture(scope="module")
def browser() -> Iterator[Chromium]:
    """Return one browser for all tests."""
    if BINARY is None:
        needed = {"CI", "MICROPLAN_NEEDS_BROWSER"} & set(os.environ)
        assert not needed, "pages are to be tested in Chromium, and there is none"
        pytest.skip("no Chromium here: apt-get install chromium")
    with Chromium(BINARY) as found:
        yield found


@pytest.fixture(scope="module", params=PAGES)
def shown(
    browser: Chromium, pages: dict[str, Path], request: pytest.FixtureRequest
) -> Chromium:
    """Return the browser with one of the pages; tests of a page follow each other."""
    browser.view(1280)
    browser.open(pages[request.param])
    return browser


def test_nothing_is_fetched_said_or_run(shown: Chromium) -> None:
    assert shown.requests() == []
    assert shown.messages() == []
    assert shown.evaluate("document.scripts.length") == 0


@pytest.mark.parametrize("width", [320, 390, 1280])
def test_nothing_is_wider_than_the_window(shown: Chromium, width: int) -> None:
    shown.view(width, phone=width < 1000)
    shown.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert shown.evaluate("document.documentElement.scrollWidth") == width
    assert shown.evaluate(WIDE) == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_what_is_behind_it(shown: Chromium, scheme: str) -> None:
    shown.view(1280, scheme=scheme)
    found = shown.evaluate(CONTRASTS)
    assert len(found) > 100
    weak = [row for row in found if row[0] < (LARGE if row[1] else NEEDED)]
    assert weak == []
    behind = shown.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (behind == "rgb(255, 255, 255)") == (scheme == "light")


def test_a_screen_reader_gets_names_and_places(shown: Chromium) -> None:
    shown.view(1280)
    nodes = shown.call("Accessibility.getFullAXTree")["nodes"]
    roles: dict[str, list[str]] = {}
    for node in nodes:
        if not node.get("ignored"):
            said = node.get("name", {}).get("value", "")
            roles.setdefault(node["role"]["value"], []).append(said)
    assert len(roles["main"]) == 1
    assert "Contents" in roles["navigation"]
    assert all(roles["image"])
    assert all(roles["link"])
    assert all(roles.get("radio", ["none needed"]))
    levels = shown.evaluate(
        "[...document.querySelectorAll('h1,h2,h3,h4')].map(h => +h.tagName[1])"
    )
    assert levels[0] == 1
    assert max(b - a for a, b in pairwise(levels)) <= 1


def test_a_row_leads_to_its_place_in_the_picture(
    browser: Chromium, pages: dict[str, Path]
) -> None:
    browser.view(1280)
    browser.open(pages["plan"])
    target = browser.evaluate(
        "[...document.querySelectorAll('td a, th a')].map(a => a.getAttribute('href'))"
        ".find(h => h.startsWith('#r.at.over'))"
    )
    width = f"""(() => {{ const g = document.getElementById({json.dumps(target[1:])});
      const e = g.lastElementChild; return [parseFloat(getComputedStyle(e).strokeWidth),
      g.getBoundingClientRect().top, innerHeight] }})()"""
    before = browser.evaluate(width)
    browser.evaluate(f"location.hash = {json.dumps(target)}")
    after = browser.evaluate(width)
    assert after[0] > before[0]
    assert 0 <= after[1] < after[2]


def test_drawing_and_image_flicker_without_a_script(
    browser: Chromium, pages: dict[str, Path]
) -> None:
    look = """(() => { const v = document.querySelector('fieldset.views');
      const s = getComputedStyle(v.querySelector('.drawn'));
      const m = getComputedStyle(v.querySelector('.marks'));
      return [s.visibility, s.animationName, s.opacity, m.visibility] })()"""
    press = "document.querySelector('fieldset.views .as-{}').click()"
    browser.view(1280)
    browser.open(pages["plan"])
    assert browser.evaluate(look)[:2] == ["hidden", "none"]
    browser.evaluate(press.format("drawing"))
    assert browser.evaluate(look)[:2] == ["visible", "none"]
    browser.evaluate(press.format("image"))
    assert browser.evaluate(look)[3] == "hidden"
    browser.evaluate(press.format("flicker"))
    assert browser.evaluate(look)[:2] == ["visible", "flick"]
    browser.view(1280, motion="reduce")
    found = browser.evaluate(look)
    assert found[:3] == ["visible", "none", "0.5"]


def test_the_first_page_prints_as_one_page(
    browser: Chromium, pages: dict[str, Path]
) -> None:
    browser.view(1280)
    browser.open(pages["plan"])
    whole = browser.pdf()
    assert whole.startswith(b"%PDF-")
    assert _pages(whole) > 10
    rest = "document.querySelectorAll('main > :not(.first), footer')"
    browser.evaluate(f"{rest}.forEach(e => e.remove())")
    for letter in (False, True):
        assert _pages(browser.pdf(letter=letter)) == 1


def _pages(pdf: bytes) -> int:
    """Return how many pages a PDF has: the largest count of its page tree."""
    return max(int(n) for n in re.findall(rb"/Count (\d+)", pdf))


def test_what_is_folded_is_printed(browser: Chromium, pages: dict[str, Path]) -> None:
    browser.view(1280)
    browser.open(pages["plan"])
    browser.call("Emulation.setEmulatedMedia", media="print")
    seen = browser.evaluate(
        "[...document.querySelectorAll('details')].every(d =>"
        " d.lastElementChild.getBoundingClientRect().height > 10)"
    )
    browser.view(1280)
    assert seen
