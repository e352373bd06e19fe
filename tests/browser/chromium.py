"""Headless Chromium by the Chrome DevTools protocol, over a pipe: nothing to install.

No port is opened, no driver is needed. `--remote-debugging-pipe` reads commands from
file descriptor 3 and writes answers to 4, JSON with a zero byte after each.
"""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome")
WAIT_S = 60.0  # for any answer: a limit that catches hangs, on a busy machine too
_FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
    "--no-first-run", "--disable-background-networking", "--disable-sync",
    "--disable-component-update", "--disable-default-apps", "--hide-scrollbars",
    "--remote-debugging-pipe", "--no-default-browser-check", "--disable-extensions",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)  # fmt: skip


def find() -> str | None:
    """Return the path of a Chromium, None if there is none."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Chromium:
    """One running browser with one page; closed with the `with` block."""

    def __init__(self, binary: str) -> None:
        self._folder = tempfile.TemporaryDirectory()
        command_out, self._to = os.pipe()
        self._from, answers_in = os.pipe()
        line = f'exec "$@" 3<&{command_out} 4>&{answers_in}'
        profile = f"--user-data-dir={self._folder.name}"
        self._process = subprocess.Popen(
            ["bash", "-c", line, "bash", binary, *_FLAGS, profile, "about:blank"],
            pass_fds=(command_out, answers_in),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(command_out)
        os.close(answers_in)
        self._count, self._rest, self._session = 0, b"", ""
        self.events: list[dict[str, Any]] = []
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(t["targetId"] for t in targets if t["type"] == "page")
        attached = self.call("Target.attachToTarget", targetId=page, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Network", "Log", "Runtime"):
            self.call(f"{domain}.enable")

    def __enter__(self) -> Chromium:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the browser."""
        os.close(self._to)
        os.close(self._from)
        self._process.terminate()
        self._process.wait(WAIT_S)
        self._folder.cleanup()

    def call(self, method: str, **given: Any) -> Any:
        """Return the answer to a command; what happens meanwhile goes to `events`."""
        self._count += 1
        message: dict[str, Any] = {
            "id": self._count, "method": method, "params": given,
        }  # fmt: skip
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            found = self._next()
            if found.get("id") == self._count:
                if "error" in found:
                    raise RuntimeError(f"{method}: {found['error']}")
                return found["result"]
            self.events.append(found)

    def open(self, file: Path) -> None:
        """Load a file and wait until it is there."""
        self.events.clear()
        self.call("Page.navigate", url=file.resolve().as_uri())
        self.wait_for("Page.loadEventFired")

    def wait_for(self, event: str) -> None:
        """Wait until an event has happened since the last `open`."""
        while not any(e.get("method") == event for e in self.events):
            self.events.append(self._next())

    def view(
        self,
        width: int,
        height: int = 900,
        *,
        scheme: str = "light",
        motion: str = "no-preference",
        phone: bool = False,
    ) -> None:
        """Set the window and what the reader prefers."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=phone,
        )  # fmt: skip
        features = [
            {"name": "prefers-color-scheme", "value": scheme},
            {"name": "prefers-reduced-motion", "value": motion},
        ]
        self.call("Emulation.setEmulatedMedia", media="", features=features)

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression; the page itself has none."""
        found = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True,
            awaitPromise=True,
        )  # fmt: skip
        if "exceptionDetails" in found:
            raise RuntimeError(str(found["exceptionDetails"]))
        return found["result"].get("value")

    def screenshot(self, *, whole: bool = False) -> bytes:
        """Return a PNG of the window, or of the whole page."""
        found = self.call("Page.captureScreenshot", captureBeyondViewport=whole)
        return base64.b64decode(found["data"])

    def pdf(self, *, letter: bool = False) -> bytes:
        """Return the page as it is printed, on A4 or Letter, with its own margins."""
        width, height = (8.5, 11.0) if letter else (8.27, 11.69)
        found = self.call(
            "Page.printToPDF", paperWidth=width, paperHeight=height,
            printBackground=True, preferCSSPageSize=False,
        )  # fmt: skip
        return base64.b64decode(found["data"])

    def requests(self) -> list[str]:
        """Return what was asked for since the last `open`, but `data:` and the file."""
        sent = [
            e for e in self.events if e.get("method") == "Network.requestWillBeSent"
        ]
        urls = [e["params"]["request"]["url"] for e in sent]
        return [url for url in urls if not url.startswith(("data:", "file:"))]

    def messages(self) -> list[str]:
        """Return what the console said since the last `open`."""
        kinds = (
            "Log.entryAdded",
            "Runtime.consoleAPICalled",
            "Runtime.exceptionThrown",
        )
        return [json.dumps(e) for e in self.events if e.get("method") in kinds]

    def _next(self) -> dict[str, Any]:
        """Return the next message of the browser."""
        ends = time.monotonic() + WAIT_S
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._from], [], [], ends - time.monotonic())
            data = os.read(self._from, 1 << 20) if ready else b""
            if not data:
                raise RuntimeError("the browser gives no answer")
            self._rest += data
        line, _, self._rest = self._rest.partition(b"\0")
        found: dict[str, Any] = json.loads(line)
        return found
