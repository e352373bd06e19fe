"""A picture of a report's first page: python -m tests.browser REPORT.html OUT.png."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.browser.chromium import Chromium, find

WIDTH, HEIGHT = 1120, 990  # of the first page of the example, down to Methods


def main(report: str, out: str) -> int:
    """Take the picture, as a reader with a light screen sees it."""
    binary = find()
    if binary is None:
        sys.exit("no Chromium here: apt-get install chromium")
    with Chromium(binary) as browser:
        browser.view(WIDTH, HEIGHT)
        browser.open(Path(report))
        Path(out).write_bytes(browser.screenshot())
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
