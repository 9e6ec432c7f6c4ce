"""Pictures of the pages in docs/pictures, by a headless Chromium: `python -m tests.support.screenshots [NAME ...]`."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import graspfx as gx
from graspfx.live.live_run import LiveRun
from graspfx.live.sliders import sliders
from graspfx.live.touch_run import TouchRun
from graspfx.live.view.live_page import LivePage
from graspfx.screen.gate import gate_for, listen, url
from tests.support.chromium import Browser, chromium, program
from tests.support.rooms import ROOT
from tests.support.view_page import serving
from tests.support.waiting import wait_until

PICTURES = ROOT / "docs" / "pictures"
WIDTH, HEIGHT = 1280, 800
LARGEST = 300_000  # bytes of a picture


def view_mug(browser: Browser, file: Path) -> None:
    """Show a mug in a hand of five fingers."""
    _view(browser, file, "mug", {})


def view_unstable(browser: Browser, file: Path) -> None:
    """Show gains beyond their limit, before anything shakes."""
    _view(browser, file, "sphere-three-fingers", {}, beyond="coupling.internal.stiffness")


def _view(browser: Browser, file: Path, name: str, values: Mapping[str, object], beyond: str = "") -> None:
    scene = gx.load(name, dict(values))
    numbers = sliders(scene)
    with (
        TemporaryDirectory() as folder,
        LiveRun(scene, live=[each.key for each in numbers], guide="hands") as run,
        LivePage(run, numbers, lambda: Path(folder), port=0, tell=lambda _: None) as view,
        serving(view),
    ):
        page = browser.open(view.server.url, WIDTH, 1330)
        page.wait_for("document.body.innerText.includes('full; spectral radius')", 120.0)
        wait_until(lambda: run.time > 8.0)
        if beyond:
            verdict = view._margins.latest() if view._margins is not None else None
            limits = [row.limit for row in verdict.rows if row.mode == "internal"] if verdict is not None else []
            view.sliders.set(beyond, 1.02 * min(limits))
            page.wait_for("document.body.innerText.includes('UNSTABLE')", 60.0)
        time.sleep(1.5)
        page.screenshot(file)
        page.close()


def page_mug(browser: Browser, file: Path) -> None:
    """Show the page of a recording, while the mug is tilted."""
    _page(browser, file, "mug", 1.7, WIDTH, 1000)


def page_waving_phone(browser: Browser, file: Path) -> None:
    """Show the page of a recording as a phone does, dark."""
    _page(browser, file, "paper-waving", 1.4, 390, 844, scale=2.0, phone=True, dark=True)


def _page(browser: Browser, file: Path, name: str, time: float, width: int, height: int, **choices: Any) -> None:
    with TemporaryDirectory() as folder:
        path = gx.run(name).to_html(Path(folder) / f"{name}.html")
        page = browser.open(f"{path.as_uri()}#t={time}", width, height, **choices)
        page.wait_for(f"graspfx.time > {time - 0.1}")
        page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        page.screenshot(file)
        page.close()


def touch_cube(browser: Browser, file: Path) -> None:
    """Show two touches that hold the paper's cube and carry it to the right."""
    with (
        listen("127.0.0.1", 0) as line,
        TouchRun(gx.load("paper-waving"), line, gate_for(line, lan=False)) as touch,
    ):
        page = browser.open(url(line), 1024, 720, phone=True)
        page.wait_for("window.graspfx().picture !== null")
        while not page.evaluate("window.graspfx().touches.length"):  # lost where the first drawings take too long
            page.touch([page.evaluate(f"window.graspfx().place({x}, 0.0)") for x in (-0.025, 0.025)], "touchStart")
            time.sleep(1.0)
            if not page.evaluate("window.graspfx().touches.length"):
                page.touch([], "touchEnd")
        for k in range(1, 60):
            half, right = 0.025 - 0.01 * min(1.0, k / 10), 0.002 * max(0, k - 25)
            places = [page.evaluate(f"window.graspfx().place({right + side * half}, 0.0)") for side in (-1.0, 1.0)]
            page.touch(places, "touchMove")
            if k == 25:
                wait_until(lambda: touch.run.time > 6.0, 60.0)
        page.screenshot(file)
        page.close()


PAGES: dict[str, Callable[[Browser, Path], None]] = {
    "touch": touch_cube, "view-mug": view_mug, "view-unstable": view_unstable,
    "page-mug": page_mug, "page-waving-phone": page_waving_phone,
}  # fmt: skip


def thin(file: Path) -> None:
    """Write a picture in few colours, of which not all are the right ones."""
    from PIL import Image

    image = Image.open(file).convert("RGB")
    image.quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).save(file, optimize=True)


def main(names: list[str]) -> int:
    """Draw the pages of these names, or all; say which browser is missing."""
    if program() is None:
        print(f"no Chromium here (GRASPFX_CHROMIUM={os.environ.get('GRASPFX_CHROMIUM', '')}): no picture of a page")
        return 0
    with chromium() as browser:
        for name in names or PAGES:
            file = PICTURES / f"{name}.png"
            PAGES[name](browser, file)
            if file.stat().st_size > LARGEST:
                thin(file)
            print(f"{file}: {file.stat().st_size // 1000} kB")
            if file.stat().st_size > LARGEST:
                return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
