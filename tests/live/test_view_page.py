"""The page of a running scene in a browser: its picture, hands on it, orders from it, and what two of them see."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

import graspfx as gx
from graspfx.live.live_run import LiveRun
from graspfx.live.sliders import sliders
from graspfx.live.view.live_view import LiveView
from graspfx.recording.record import Recording
from graspfx.show.style import CONTACTS, EXTERNAL, INTERNAL
from tests.support.chromium import Browser, Page, Pixels
from tests.support.view_page import PLAIN, serving
from tests.support.waiting import comes
from tests.support.waiting import wait_until as until

pytestmark = pytest.mark.alone

pytest.importorskip("viser", reason="the view needs viser: pip install 'graspfx[view]'")

STIFFNESS = "coupling.external.stiffness"
SLOW = """(() => {
  const own = window.requestAnimationFrame.bind(window); let last = 0;
  window.requestAnimationFrame = call => own(function wait(time) {
    if (performance.now() - last > 90) { last = performance.now(); call(time); } else setTimeout(() => own(wait), 30);
  });
})()"""  # about ten pictures a second: they are drawn by processors that others need, too
ARROW = "document.querySelectorAll('.mantine-Slider-root').length > 1"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("view")


@pytest.fixture(scope="module")
def view(chromium: Browser, folder: Path) -> Iterator[LiveView]:
    """Run a scene whose external stiffness can change, each finger's hand guided, and serve its page."""
    scene = gx.load("paper-waving")
    numbers = [each for each in sliders(scene) if each.key == STIFFNESS]
    names = count()
    with (
        LiveRun(scene, live=[STIFFNESS], guide="hands") as run,
        LiveView(run, numbers, lambda: folder / f"recording-{next(names)}", port=0, tell=lambda _: None) as view,
        serving(view),
    ):
        yield view


@pytest.fixture(scope="module")
def page(chromium: Browser, view: LiveView) -> Iterator[Page]:
    page = opened(chromium, view)
    yield page
    page.close()


def opened(browser: Browser, view: LiveView, width: int = 1200, height: int = 560, scale: float = 1.0) -> Page:
    before = len(view.server.viser.get_clients())
    page = browser.open(view.server.url, width, height, scale=scale, before=SLOW)
    page.evaluate(PLAIN)
    page.wait_for(ARROW)
    until(lambda: len(view.server.viser.get_clients()) > before)
    until(lambda: is_in_place(view))
    time.sleep(0.4)
    return page


def place(page: Page, view: LiveView, point: ArrayLike) -> tuple[float, float]:
    """Project a point in space [m] onto a page's picture [CSS pixels]."""
    x, y, w, h = page.evaluate(
        "(() => { const b = document.querySelector('canvas').getBoundingClientRect();"
        " return [b.left, b.top, b.width, b.height] })()"
    )
    camera = list(view.server.viser.get_clients().values())[-1].camera
    a, b, c, d = camera.wxyz
    turn = np.array([
        [1 - 2 * (c * c + d * d), 2 * (b * c - d * a), 2 * (b * d + c * a)],
        [2 * (b * c + d * a), 1 - 2 * (b * b + d * d), 2 * (c * d - b * a)],
        [2 * (b * d - c * a), 2 * (c * d + b * a), 1 - 2 * (b * b + c * c)],
    ])  # fmt: skip
    right, down, away = turn.T @ (np.asarray(point, dtype=float) - camera.position)
    focal = 0.5 * h / np.tan(0.5 * camera.fov)
    return x + 0.5 * w + focal * right / away, y + 0.5 * h + focal * down / away


def is_in_place(view: LiveView) -> bool:
    """Tell whether the newest page looks from where it should: viser's own camera is some metres away at first."""
    camera = list(view.server.viser.get_clients().values())[-1].camera
    start = np.asarray(view.server.viser.initial_camera.position)
    return bool(np.linalg.norm(camera.position - start) < 1e-3)


def near(pixels: Pixels, colour: str, tolerance: int = 60) -> NDArray[np.bool_]:
    """Mark the pixels that have about a colour, (h, w)."""
    target = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    return np.asarray((np.abs(pixels.astype(int) - target) <= tolerance).all(axis=2))


def vermilion(pixels: Pixels) -> NDArray[np.bool_]:
    """Mark the pixels that are vermilion, or that are seen through an object (h, w); axes of gizmos are pink."""
    red, green, blue = np.moveaxis(pixels.astype(int), 2, 0)
    return np.asarray((red > green + 25) & (green > blue + 15))


def press(page: Page, text: str) -> None:
    """Press the button that has this text."""
    page.evaluate(f"[...document.querySelectorAll('button')].find(b => b.textContent === '{text}').click()")


def test_the_page_shows_forces_states_and_charts_and_asks_nobody_else(page: Page, view: LiveView, folder: Path) -> None:
    canvas = slice(345, 855)  # between the panels

    def shows_squeeze_and_states() -> bool:
        middle = page.screenshot()[:, canvas]
        return near(middle, INTERNAL, 50).sum() > 60 and near(middle, CONTACTS["touch"], 95).sum() > 40

    until(shows_squeeze_and_states)
    until(lambda: vermilion(page.screenshot()[:, canvas]).sum() > 12)  # it comes and goes with the waving
    chart = page.screenshot(folder / "page.png")[:, :340]
    assert near(chart, INTERNAL, 20).sum() > 200
    assert near(chart, EXTERNAL, 20).sum() > 100
    assert page.console_errors == []
    assert {url.replace("ws:", "http:").rstrip("/") for url in page.requests} == {view.server.url}
    text = page.evaluate("document.body.innerText")
    for words in ("squeeze (internal)", "push (external)", "touches", "running in real time", "mm long"):
        assert words in text
    page.wait_for("document.body.innerText.includes('spectral radius')")


def test_a_gizmo_that_is_dragged_leads_the_fingers_and_they_stay_there_when_its_client_leaves(
    browser: Browser, page: Page, view: LiveView
) -> None:
    other = opened(browser, view, 1100, 460, scale=0.4)
    size = 0.34 * view._scenery.extent
    start = np.append(view.run.guides[1].position, 0.0)
    along = np.array([0.0, 1.0, 0.0])
    grip, end = (place(other, view, start + share * size * along) for share in (0.7, 1.2))
    led = False
    for _ in range(4):  # a slow picture may not have seen the pointer yet when it is pressed
        other.mouse("mouseMoved", *grip, button="none", buttons=0)
        time.sleep(0.6)
        other.mouse("mousePressed", *grip)
        for share in np.linspace(0.0, 1.0, 8):
            other.mouse("mouseMoved", *(np.array(grip) + share * (np.array(end) - np.array(grip))))
            time.sleep(0.05)
        led = comes(lambda: view._hands._gizmos[1].position[1] > 0.3 * size, 2.0)
        if led:
            break
        other.mouse("mouseReleased", *end)
    other.close()  # in mid-drag
    assert led
    goal = float(view._hands._gizmos[1].position[1])
    until(lambda: view.server.pages == 1)
    time.sleep(0.5)
    names = view.run.layout.columns
    row = view.run.row()
    assert row is not None
    finger = row[names["true_position"].where].reshape(names["true_position"].shape)[1]
    assert finger[1] > 0.3 * goal  # the object and its friction hold the finger back
    assert view.run.state == "running"
    tick = view.run.tick
    assert view.run.await_row(tick + 10, 5.0)
    view.run.guide(1, np.zeros(2))


def test_a_slider_changes_the_gain_its_recording_says_at_which_tick_and_both_clients_see_it(
    browser: Browser, page: Page, view: LiveView, folder: Path
) -> None:
    other = opened(browser, view, 900, 320, scale=0.4)
    press(page, "Record")
    until(lambda: view._recording)
    before = view.run.tick
    number = "[...document.querySelectorAll('input')].map(each => each.value)"
    rail = page.evaluate(
        "(() => { const r = [...document.querySelectorAll('.mantine-Slider-root')];"
        " const b = r[r.length - 1].getBoundingClientRect(); return [b.left, b.top, b.width, b.height] })()"
    )
    page.click(rail[0] + 0.5 * rail[2], rail[1] + 0.5 * rail[3])
    value = until(lambda: view.sliders.values[STIFFNESS] != 30.0 and view.sliders.values[STIFFNESS])
    assert value
    until(lambda: view.run.scene.coupling.external.stiffness == value)
    until(lambda: f"{value:g}" in other.evaluate(number))
    assert f"{value:g}" in page.evaluate(number)
    handle = view.sliders._handles[STIFFNESS]
    assert handle.value == value
    after = view.run.tick
    press(other, "Stop")
    until(lambda: view._last)
    assert view._last is not None
    recording = Recording.load(view._last)
    ticks = [change.tick for change in recording.changes if change.key == STIFFNESS and change.value == value]
    assert len(ticks) == 1
    assert before - 5 <= ticks[0] <= after
    again = gx.replay(recording)
    assert np.array_equal(again.finger_force, recording.finger_force)
    press(other, "Replay")
    page.wait_for("[...document.querySelectorAll('.gfx b')].some(b => b.textContent === 'replay')")
    press(page, "Live")
    page.wait_for("document.body.innerText.includes('running in real time')")


def test_pause_step_and_reset(page: Page, view: LiveView) -> None:
    press(page, "Pause")
    until(lambda: view.run.state == "paused")
    time.sleep(0.1)
    tick = view.run.tick
    press(page, "Step")
    until(lambda: view.run.tick == tick + 10)
    time.sleep(0.1)
    assert view.run.tick == tick + 10
    number = view.run.run_number
    press(page, "Reset")
    until(lambda: view.run.run_number > number and view.run.state == "running")
    page.wait_for("document.body.innerText.includes('running in real time')")


def test_gains_beyond_the_limit_redden_the_page_before_anybody_waits(page: Page, view: LiveView, folder: Path) -> None:
    slider = view.sliders._handles[STIFFNESS]
    view.sliders.set(STIFFNESS, slider.max)
    page.wait_for("document.body.innerText.includes('UNSTABLE')")
    time.sleep(0.4)
    pixels = page.screenshot(folder / "unstable.png")
    assert near(pixels[:38], "#b3001b", 20).mean() > 0.6  # the banner
    assert near(pixels[60:, :320], "#ffe3e6", 12).mean() > 0.3  # the panels
    view.sliders.set(STIFFNESS, 30.0)
    page.wait_for("!document.body.innerText.includes('UNSTABLE')")
