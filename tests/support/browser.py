"""Headless Chromium, driven through its DevTools protocol over a pair of pipes: no driver, no port, no package."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Any, Self

INSTALL = "apt-get install chromium"
PATIENCE_S = 60.0  # a command of the protocol; a loaded machine is slow
PHONE, DESKTOP = (390, 844), (1280, 900)  # px
_OPTIONS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
    "--remote-debugging-pipe", "about:blank",
)  # fmt: skip


def find_browser() -> str | None:
    """The path of Chromium or Chrome, None if there is none; in continuous integration there has to be one."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None and os.environ.get("CI"):
        raise RuntimeError(f"pages are not tested: Chromium is not installed: {INSTALL}")
    return found


class Browser:
    """A browser with one page, for use in a ``with`` statement.

    ``errors`` are the errors and warnings of the console and uncaught exceptions, ``requests`` the addresses that pages
    asked for besides their own files.
    """

    def __init__(self) -> None:
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._events: list[str] = []
        self._opened = ""
        self._count = 0
        self._rest = b""

    def __enter__(self) -> Self:
        program = find_browser()
        assert program is not None, INSTALL
        self._folder = tempfile.TemporaryDirectory(prefix="ps_fmu_browser_", ignore_cleanup_errors=True)
        ends = [*os.pipe(), *os.pipe()]
        # Chromium reads 3 and writes 4: ours are moved away first.
        inside_read, self._write, self._read, inside_write = (fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in ends)
        for end in ends:
            os.close(end)

        def place() -> None:
            os.dup2(inside_read, 3)
            os.dup2(inside_write, 4)

        self._process = subprocess.Popen(
            [program, *_OPTIONS, f"--user-data-dir={self._folder.name}"],
            pass_fds=(3, 4), preexec_fn=place, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(inside_read)
        os.close(inside_write)
        self._session: str | None = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.resize(*DESKTOP)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.terminate()
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._read)
        os.close(self._write)
        self._folder.cleanup()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The result of a command of the protocol; raises RuntimeError with what the browser says."""
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        deadline = monotonic() + PATIENCE_S
        while True:
            answer = self._receive(deadline)
            if answer.get("id") == self._count:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return dict(answer["result"])
            self._note(answer)

    def open(self, path: Path) -> None:
        """Open a file and wait until it is loaded."""
        self._opened = path.absolute().as_uri()
        self._events.clear()
        self.call("Page.navigate", url=self._opened)
        deadline = monotonic() + PATIENCE_S
        while "Page.loadEventFired" not in self._events:
            self._note(self._receive(deadline))

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression, awaited; raises RuntimeError if it throws."""
        found = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in found:
            raise RuntimeError(str(found["exceptionDetails"]))
        return found["result"].get("value")

    def text(self, selector: str) -> str:
        """The text of the first element of a selector."""
        return str(self.evaluate(f"document.querySelector({json.dumps(selector)}).textContent"))

    def wait_frames(self, count: int = 2) -> None:
        """Let the page draw."""
        self.evaluate(
            f"(async () => {{ for (let i = 0; i < {count}; i++) await new Promise(requestAnimationFrame); }})()"
        )

    def place(self, selector: str) -> tuple[float, float, float, float]:
        """Left, top, width and height in the window of the first element of a selector, scrolled into view, px."""
        box = self.evaluate(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)});"
            " e.scrollIntoView({block: 'center'});"
            " const b = e.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; })()"
        )
        left, top, width, height = map(float, box)
        return left, top, width, height

    def click(self, selector: str) -> None:
        """Click the middle of an element."""
        left, top, width, height = self.place(selector)
        self.mouse("mousePressed", left + width / 2, top + height / 2)
        self.mouse("mouseReleased", left + width / 2, top + height / 2)
        self.wait_frames()

    def mouse(self, kind: str, x: float, y: float, *, buttons: int = 1, **more: Any) -> None:
        """A mouse event of the protocol: mousePressed, mouseMoved, mouseReleased, mouseWheel."""
        pressed = {} if kind in {"mouseMoved", "mouseWheel"} else {"button": "left", "clickCount": 1}
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, buttons=buttons, **pressed, **more)

    def drag(self, selector: str, first: float, last: float) -> None:
        """Drag across an element from one share of its width to another, half-way up."""
        left, top, width, height = self.place(selector)
        y = top + height / 2
        self.mouse("mouseMoved", left + first * width, y, buttons=0)
        self.mouse("mousePressed", left + first * width, y)
        for share in (first + (last - first) * k / 5 for k in range(1, 6)):
            self.mouse("mouseMoved", left + share * width, y)
        self.mouse("mouseReleased", left + last * width, y)
        self.wait_frames()

    def touch(self, kind: str, points: list[tuple[float, float]]) -> None:
        """A touch event of the protocol: touchStart, touchMove, touchEnd."""
        touches = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)]
        self.call("Input.dispatchTouchEvent", type=kind, touchPoints=touches)

    def resize(self, width: int, height: int, *, mobile: bool = False) -> None:
        """Size of the window, px; a mobile one has a touch screen."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=2 if mobile else 1, mobile=mobile,
        )  # fmt: skip
        self.call("Emulation.setTouchEmulationEnabled", enabled=mobile)

    def prefer(self, scheme: str) -> None:
        """The system's colours: light or dark."""
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def screenshot(self, path: Path, *, whole: bool = True) -> None:
        """A picture of the page, PNG."""
        shot = self.call("Page.captureScreenshot", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(shot["data"]))

    def print(self, path: Path) -> None:
        """The page as PDF on A4."""
        paper = self.call("Page.printToPDF", paperWidth=8.27, paperHeight=11.69, printBackground=True)
        path.write_bytes(base64.b64decode(paper["data"]))

    def _receive(self, deadline: float) -> dict[str, Any]:
        while b"\0" not in self._rest:
            if not select.select([self._read], [], [], max(deadline - monotonic(), 0.0))[0]:
                raise TimeoutError(f"the browser does not answer for {PATIENCE_S:g} s")
            piece = os.read(self._read, 1 << 20)
            if not piece:
                raise RuntimeError("the browser has ended")
            self._rest += piece
        message, _, self._rest = self._rest.partition(b"\0")
        return dict(json.loads(message))

    def _note(self, event: Mapping[str, Any]) -> None:
        method, told = event.get("method", ""), event.get("params", {})
        self._events.append(method)
        if method == "Runtime.exceptionThrown":
            self.errors.append(str(told["exceptionDetails"].get("exception", told["exceptionDetails"])))
        elif method == "Runtime.consoleAPICalled" and told["type"] in {"error", "warning", "assert"}:
            self.errors.append(str(told["args"]))
        elif method == "Log.entryAdded" and told["entry"]["level"] in {"error", "warning"}:
            self.errors.append(f"{told['entry']['text']} {told['entry'].get('url', '')}")
        elif method == "Network.requestWillBeSent":
            address = told["request"]["url"]
            if address.split("#")[0] != self._opened and not address.startswith("data:"):
                self.requests.append(address)
