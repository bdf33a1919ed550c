"""Chromium without a display: opens a page, runs JavaScript in it, takes pictures.

It is driven by the DevTools protocol over a pipe, so no other package is needed. Everything is
drawn by software; the network is off.
"""

import base64
import json
import os
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from dockloop.base.errors import DockloopError
from dockloop.base.files import scratch

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_PATIENCE = 180.0  # s for one answer
_OPTIONS = (
    *("--headless=new", "--remote-debugging-pipe", "--no-first-run", "--hide-scrollbars"),
    *("--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-dev-shm-usage", "--disable-extensions", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--no-default-browser-check", "--mute-audio"),
    *("--force-color-profile=srgb", "--host-resolver-rules=MAP * ~NOTFOUND"),
)
_TAKE_OVER = (  # what the process does before it becomes the browser
    "import os, sys; r, w, *words = sys.argv[1:]; os.dup2(int(r), 3); os.dup2(int(w), 4);"
    " os.closerange(10, max(int(r), int(w)) + 1); os.execv(words[0], words)"
)


def find_browser() -> str | None:
    """Return the path of Chromium or Chrome; ``DOCKLOOP_BROWSER`` names another one."""
    names = [os.environ.get("DOCKLOOP_BROWSER") or "", *PROGRAMS]
    return next((found for name in names if name and (found := shutil.which(name))), None)


class Browser:
    """One page in Chromium; a context manager.

    Attributes:
        messages: errors and warnings of the console, exceptions, requests that were not for a file.
    """

    def __init__(self, width: int, height: int, ratio: float = 1.0) -> None:
        """Note the size of the window, in CSS pixels, and how many pixels each has."""
        self._size = {"width": width, "height": height, "deviceScaleFactor": ratio}
        self.messages: list[str] = []
        self._last = 0
        self._session: str | None = None
        self._loaded = False
        self._rest = b""

    def __enter__(self) -> "Browser":
        program = find_browser()
        if not program:
            raise DockloopError(
                "pictures need Chromium or Chrome: install it (apt-get install chromium), or let"
                " DOCKLOOP_BROWSER name one; the page itself needs none"
            )
        if sys.platform == "win32":
            raise DockloopError("pictures are not made on Windows: open the page and take them")
        self._folder = scratch()
        profile = self._folder.__enter__()
        words = [program, *_OPTIONS, f"--user-data-dir={profile}"]
        if os.geteuid() == 0:
            words.append("--no-sandbox")  # Chromium refuses to run for root otherwise
        self._start(words)
        try:
            self._attach()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """End the browser that was started, and it alone."""
        try:
            self._session = None
            self.call("Browser.close")
        except (DockloopError, OSError):
            self._process.terminate()
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._write)
        os.close(self._read)
        self._folder.__exit__(None, None, None)

    def open(self, page: Path) -> None:
        """Open a file and wait until its motion is drawn."""
        self._loaded = False
        self.call("Page.navigate", url=page.resolve().as_uri())
        end = time.monotonic() + _PATIENCE
        while not (self.run("Boolean(window.dockloop)") and self._loaded):
            if time.monotonic() > end:
                why = self.messages[0] if self.messages else "it did not load"
                raise DockloopError(f"{page}: Chromium cannot show it ({why})")
            time.sleep(0.05)

    def run(self, code: str) -> Any:
        """Return the value of a JavaScript expression."""
        answer = self.call(
            "Runtime.evaluate", expression=code, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            text = details.get("exception", {}).get("description", details["text"])
            raise DockloopError(f"Chromium: {text}")
        return answer["result"].get("value")

    def settle(self) -> None:
        """Wait until the page has drawn itself twice."""
        frames = "requestAnimationFrame(() => requestAnimationFrame(() => done(true)))"
        self.run(f"new Promise((done) => {frames})")

    def take_picture(self) -> bytes:
        """Return the window as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def call(self, method: str, **parameters: Any) -> dict:
        """Send one command and return its result."""
        self._last += 1
        number = self._last
        message: dict = {"id": number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        try:
            rest = json.dumps(message).encode() + b"\0"
            while rest:
                rest = rest[os.write(self._write, rest) :]
        except OSError:
            raise DockloopError("Chromium ended unexpectedly") from None
        while True:
            answer = self._receive()
            if answer.get("id") == number:
                if "error" in answer:
                    raise DockloopError(f"Chromium: {answer['error']['message']} ({method})")
                return answer["result"]
            self._note(answer)

    def _start(self, words: list[str]) -> None:
        """Start the browser with the pipes that it expects at the descriptors 3 and 4."""
        import fcntl  # not on Windows

        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (to_browser, from_browser)]
        os.close(to_browser)
        os.close(from_browser)
        begin = [sys.executable, "-S", "-c", _TAKE_OVER, *map(str, ends)]
        try:
            self._process = subprocess.Popen(
                [*begin, *words],
                pass_fds=ends,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        finally:
            for end in ends:
                os.close(end)

    def _attach(self) -> None:
        """Connect to a fresh page of the wanted size."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        offline = {"offline": True, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}
        self.call("Network.emulateNetworkConditions", **offline)
        self.call("Emulation.setDeviceMetricsOverride", mobile=False, **self._size)

    def _receive(self) -> dict:
        """Return the next message of the browser."""
        end = time.monotonic() + _PATIENCE
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._read], [], [], max(0.0, end - time.monotonic()))
            if not ready:
                raise DockloopError(f"Chromium gave no answer within {_PATIENCE:.0f} s")
            found = os.read(self._read, 1 << 20)
            if not found:
                raise DockloopError("Chromium ended unexpectedly: does it run by itself?")
            self._rest += found
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)

    def _note(self, event: dict) -> None:
        """Keep what a console would show."""
        inside = event.get("params", {})
        match event.get("method"):
            case "Page.loadEventFired":
                self._loaded = True
            case "Runtime.consoleAPICalled" if inside["type"] in ("error", "warning", "assert"):
                texts = (str(a.get("value", a.get("description"))) for a in inside["args"])
                self.messages.append(f"{inside['type']}: {' '.join(texts)}")
            case "Runtime.exceptionThrown":
                details = inside["exceptionDetails"]
                text = details.get("exception", {}).get("description", details["text"])
                self.messages.append(f"exception: {text}")
            case "Log.entryAdded" if inside["entry"]["level"] in ("error", "warning"):
                self.messages.append(f"{inside['entry']['level']}: {inside['entry']['text']}")
            case "Network.requestWillBeSent":
                url = inside["request"]["url"]
                if not url.startswith(("file:", "data:", "about:", "blob:")):
                    self.messages.append(f"request: {url}")
