"""A headless Chromium that opens pages, driven by its debugging protocol: what pages show, and hands on them."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from io import BytesIO
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

if TYPE_CHECKING:
    from websockets.sync.client import ClientConnection

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
OPTIONS = (
    "--headless=new", "--no-sandbox", "--remote-debugging-port=0", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--no-first-run", "--no-default-browser-check", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-extensions", "--disable-dev-shm-usage", "--mute-audio",
    "--disable-background-timer-throttling", "--disable-renderer-backgrounding",
    "--disable-backgrounding-occluded-windows", "--hide-scrollbars", "--force-color-profile=srgb",
    "--metrics-recording-only", "--disable-features=Translate",
)  # fmt: skip
START, REPLY = 60.0, 60.0  # [s]

Pixels = NDArray[np.uint8]
Point = tuple[float, float]


class PageError(AssertionError):
    """A page's script raised an error, or the browser refused a command."""


def program() -> str | None:
    """Find Chromium: where GRASPFX_CHROMIUM says, or by its usual names on the PATH; None if it is not there."""
    if name := os.environ.get("GRASPFX_CHROMIUM"):
        return shutil.which(name)
    return next((path for name in NAMES if (path := shutil.which(name))), None)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start a browser with a profile of its own, which goes with it; skip the test where there is none."""
    path = program()
    if path is None:
        pytest.skip("no Chromium here: GRASPFX_CHROMIUM does not lead to one, and none is on the PATH")
    pytest.importorskip("websockets", reason="the browser is driven over a socket: pip install websockets")
    with tempfile.TemporaryDirectory(prefix="graspfx-chromium-", ignore_cleanup_errors=True) as folder:
        command = [path, *OPTIONS, f"--user-data-dir={folder}", "about:blank"]
        quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        process = subprocess.Popen(command, **quiet, start_new_session=True)  # type: ignore[call-overload]
        try:
            browser = Browser(_address(process, Path(folder)))
            try:
                yield browser
            finally:
                browser.close()
        finally:
            _end(process)


def _address(process: subprocess.Popen[bytes], profile: Path) -> str:
    """Wait for the address at which the browser listens."""
    file, deadline = profile / "DevToolsActivePort", time.monotonic() + START
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise PageError(f"Chromium ended at its start with code {process.returncode}")
        lines = file.read_text("utf-8").split() if file.is_file() else []
        if len(lines) == 2:
            return f"ws://127.0.0.1:{lines[0]}{lines[1]}"
        time.sleep(0.02)
    raise PageError(f"Chromium did not start within {START:g} s")


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the browser's own process, and with it those that it started."""
    for end in (process.terminate, process.kill):
        try:
            process.wait(5.0)
            return
        except subprocess.TimeoutExpired:
            end()
    process.wait(5.0)


class Browser:
    """A running browser.

    Args:
        address: of its socket.
    """

    def __init__(self, address: str) -> None:
        from websockets.sync.client import connect

        line = connect(address, max_size=None, compression=None, proxy=None)
        self._socket: ClientConnection = line.__enter__()  # left by `close`
        self._numbers, self._lock = count(1), threading.Lock()
        self._replies: dict[int, Future[Any]] = {}
        self._pages: dict[str, Page] = {}
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def open(
        self, url: str, width: int = 1000, height: int = 700, *, scale: float = 1.0, phone: bool = False,
        dark: bool = False, before: str = "",
    ) -> Page:  # fmt: skip
        """Open a page in a tab of its own, and wait until it is loaded.

        Args:
            url: of the page.
            width, height: of the window [CSS pixels].
            scale: pixels in a CSS pixel.
            phone: whether it is a device with a touch screen.
            dark: whether its user likes dark pages.
            before: script that runs before those of the page.
        """
        context = self.send("Target.createBrowserContext", {})["browserContextId"]  # its own cookies and storage
        target = self.send("Target.createTarget", {"url": "about:blank", "browserContextId": context})["targetId"]
        session = self.send("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        page = self._pages[session] = Page(self, session, context)
        for domain in ("Page", "Runtime", "Log", "Network"):
            page.send(f"{domain}.enable")
        page.resize(width, height, scale=scale, phone=phone)
        page.send("Emulation.setEmulatedMedia", {
            "features": [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        })  # fmt: skip
        if before:
            page.send("Page.addScriptToEvaluateOnNewDocument", {"source": before})
        page.visit(url)
        return page

    @property
    def pages(self) -> Sequence[Page]:
        """The pages that are open."""
        return [*self._pages.values()]

    def send(self, method: str, parameters: Mapping[str, Any], session: str = "") -> dict[str, Any]:
        """Send a command, and wait for its answer.

        Raises:
            PageError: the browser refused it, or does not answer.
        """
        number, reply = next(self._numbers), Future[Any]()
        self._replies[number] = reply
        message = {"id": number, "method": method, "params": dict(parameters)}
        with self._lock:
            self._socket.send(json.dumps(message | ({"sessionId": session} if session else {})))
        try:
            answer: dict[str, Any] = reply.result(REPLY)
        except TimeoutError:
            raise PageError(f"{method}: no answer within {REPLY:g} s") from None
        if "error" in answer:
            raise PageError(f"{method}: {answer['error'].get('message')}")
        return dict(answer.get("result", {}))

    def close(self) -> None:
        """End the browser."""
        with suppress(Exception):
            self.send("Browser.close", {})
        self._socket.close()
        self._reader.join(5.0)

    def _read(self) -> None:
        """Hand answers to those who wait for them, and events to their pages."""
        with suppress(Exception):  # the end of the connection
            for message in self._socket:
                data = json.loads(message)
                if "id" in data:
                    self._replies.pop(data["id"]).set_result(data)
                elif page := self._pages.get(data.get("sessionId", "")):
                    page._take(data["method"], data["params"])
        for reply in [*self._replies.values()]:
            if not reply.done():
                reply.set_exception(PageError("the browser has ended"))


class Page:
    """A page in a tab.

    Attributes:
        console_errors: of its scripts and of what it loads.
        requests: addresses of all that it asked for, its own first; `data:` and `blob:` are left out.
    """

    def __init__(self, browser: Browser, session: str, context: str) -> None:
        self._browser, self._session, self._context = browser, session, context
        self._loaded = threading.Event()
        self.console_errors: list[str] = []
        self.requests: list[str] = []

    def send(self, method: str, parameters: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Send a command of the protocol to this page."""
        return self._browser.send(method, parameters or {}, self._session)

    def visit(self, url: str, seconds: float = REPLY) -> None:
        """Go to an address, and wait until it is loaded.

        Raises:
            PageError: it cannot be reached, or takes too long.
        """
        self._loaded.clear()
        answer = self.send("Page.navigate", {"url": url})
        if answer.get("errorText"):
            raise PageError(f"{url}: {answer['errorText']}")
        if not self._loaded.wait(seconds):
            raise PageError(f"{url}: not loaded within {seconds:g} s")

    def evaluate(self, script: str) -> Any:
        """Evaluate an expression in the page, a promise to its end, and give its value as plain data.

        Raises:
            PageError: with what the script raised.
        """
        answer = self.send("Runtime.evaluate", {
            "expression": script, "returnByValue": True, "awaitPromise": True, "userGesture": True
        })  # fmt: skip
        if (fault := answer.get("exceptionDetails")) is not None:
            raise PageError(fault.get("exception", {}).get("description") or fault.get("text"))
        return answer["result"].get("value")

    def wait_for(self, script: str, seconds: float = REPLY) -> Any:
        """Wait until an expression is true, and give its value.

        Raises:
            PageError: it stays false.
        """
        deadline = time.monotonic() + seconds
        while not (value := self.evaluate(script)):
            if time.monotonic() > deadline:
                raise PageError(f"not true within {seconds:g} s: {script}; {self.console_errors}")
            time.sleep(0.03)
        return value

    def allow_downloads(self, folder: Path) -> None:
        """Put what the page gives for a download into a folder."""
        place = {"behavior": "allow", "downloadPath": str(folder), "browserContextId": self._context}
        self._browser.send("Browser.setDownloadBehavior", place)

    def screenshot(self, path: Path | None = None) -> Pixels:
        """Show what is seen of the page, (h, w, 3), and write it as a PNG if a path is given."""
        from PIL import Image

        png = base64.b64decode(self.send("Page.captureScreenshot", {"format": "png"})["data"])
        if path is not None:
            path.write_bytes(png)
        return np.array(Image.open(BytesIO(png)).convert("RGB"))

    def resize(self, width: int, height: int, *, scale: float = 1.0, phone: bool = False) -> None:
        """Give the page a window of a size [CSS pixels]."""
        self.send("Emulation.setDeviceMetricsOverride", {
            "width": width, "height": height, "deviceScaleFactor": scale, "mobile": phone
        })  # fmt: skip
        self.send("Emulation.setTouchEmulationEnabled", {"enabled": phone, "maxTouchPoints": 10 if phone else 1})

    def mouse(
        self, kind: str, x: float, y: float, *, button: str = "left", buttons: int = 1, clicks: int = 1,
        modifiers: int = 0,
    ) -> None:  # fmt: skip
        """Send an event of the mouse: "mousePressed", "mouseMoved" or "mouseReleased"; `modifiers` 8 is shift."""
        pressed = buttons if kind != "mouseReleased" else 0
        self.send("Input.dispatchMouseEvent", {
            "type": kind, "x": x, "y": y, "button": button, "buttons": pressed, "clickCount": clicks,
            "modifiers": modifiers,
        })  # fmt: skip

    def click(self, x: float, y: float) -> None:
        """Click at a place."""
        self.mouse("mouseMoved", x, y, button="none", buttons=0)
        self.mouse("mousePressed", x, y)
        self.mouse("mouseReleased", x, y)

    def drag(self, points: Sequence[Point], *, button: str = "left", pause: float = 0.01) -> None:
        """Press at the first point, move through the others, and release at the last."""
        buttons = {"left": 1, "right": 2, "middle": 4}[button]
        self.mouse("mouseMoved", *points[0], button="none", buttons=0)
        self.mouse("mousePressed", *points[0], button=button, buttons=buttons)
        for point in points[1:]:
            self.mouse("mouseMoved", *point, button=button, buttons=buttons)
            time.sleep(pause)
        self.mouse("mouseReleased", *points[-1], button=button)

    def wheel(self, x: float, y: float, down: float) -> None:
        """Turn the wheel over a place [CSS pixels]."""
        self.send("Input.dispatchMouseEvent", {"type": "mouseWheel", "x": x, "y": y, "deltaX": 0.0, "deltaY": down})

    def touch(self, points: Mapping[int, Point] | Sequence[Point], kind: str) -> None:
        """Send an event of the touch screen.

        Args:
            points: all that touch now, by their number or in their order; none for "touchEnd".
            kind: "touchStart", "touchMove", "touchEnd" or "touchCancel".
        """
        numbered = points if isinstance(points, Mapping) else dict(enumerate(points))
        touches = [{"x": x, "y": y, "id": number, "force": 1.0} for number, (x, y) in numbered.items()]
        self.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})

    def key(self, name: str, code: str = "", text: str = "") -> None:
        """Press and release a key, by its `KeyboardEvent.key` and `.code`."""
        what = {"key": name, "code": code or name} | ({"text": text} if text else {})
        self.send("Input.dispatchKeyEvent", {"type": "keyDown", **what})
        self.send("Input.dispatchKeyEvent", {"type": "keyUp", **what})

    def close(self) -> None:
        """Close the tab."""
        with suppress(PageError):
            self._browser.send("Target.disposeBrowserContext", {"browserContextId": self._context})
        self._browser._pages.pop(self._session, None)

    def _take(self, event: str, data: Mapping[str, Any]) -> None:
        """Note what an event says."""
        if event == "Page.loadEventFired":
            self._loaded.set()
        elif event == "Runtime.exceptionThrown":
            fault = data["exceptionDetails"]
            self.console_errors.append(str(fault.get("exception", {}).get("description") or fault.get("text")))
        elif event == "Runtime.consoleAPICalled" and data["type"] in ("error", "assert"):
            self.console_errors.append(
                " ".join(str(each.get("value", each.get("description"))) for each in data["args"])
            )
        elif event == "Log.entryAdded" and data["entry"]["level"] == "error":
            self.console_errors.append(f"{data['entry']['text']} {data['entry'].get('url', '')}".strip())
        elif event in ("Network.requestWillBeSent", "Network.webSocketCreated"):
            url = str(data["url"] if "url" in data else data["request"]["url"])
            if not url.startswith(("data:", "blob:")):
                self.requests.append(url)
