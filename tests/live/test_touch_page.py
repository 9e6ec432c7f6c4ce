"""Fingers on a touch screen hold the paper's cube: a scene that runs, its page in a browser, and hands on it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.live.touch_run import TouchRun
from graspfx.recording.record import Recording
from graspfx.screen.gate import gate_for, listen, url
from graspfx.show.style import EXTERNAL, INTERNAL
from tests.support.chromium import Browser, Page
from tests.support.waiting import wait_until as until

pytestmark = pytest.mark.alone

SQUEEZE = 0.01  # of each touch inside its face [m]
HALF = 0.025  # of the cube [m]
SERIES = 60.0 * 70.0 / (60.0 + 70.0)  # hand and internal coupling: f = k_h k_i/(k_h + k_i) s [N/m]


QUICK = """(() => {
  const drawn = window.graspfx().drawn.slice(-6).map(each => each[1]);
  return performance.now() - drawn[0] < 1000;
})()"""  # six pictures in the last second


@pytest.fixture
def touch(tmp_path: Path) -> Iterator[TouchRun]:
    """Run the scene anew for each test: cube and fingers are where they start."""
    scene = gx.load("paper-waving", {"engine": "interpreted"})
    with listen("127.0.0.1", 0) as line:
        gate = gate_for(line, lan=False)
        with TouchRun(scene, line, gate, out=tmp_path) as run:
            yield run
        assert run.fault == ""


@pytest.fixture
def page(browser: Browser, touch: TouchRun) -> Iterator[Page]:
    """Open the page on a small tablet, with nobody's finger on anything."""
    page = ready(browser, touch)
    yield page
    own = url(touch.server.line)
    assert page.console_errors == []
    assert {each.replace("ws://", "http://") for each in page.requests} <= {own, f"{own}socket"}


def ready(browser: Browser, touch: TouchRun, width: int = 560, height: int = 420) -> Page:
    """Open a page that draws as fast as it will: its first pictures take longer than a screen may be silent."""
    page = browser.open(url(touch.server.line), width, height, phone=True)
    page.wait_for("window.graspfx().drawn.length > 10")
    page.wait_for(QUICK)
    until(lambda: free(touch) and rests(touch))
    return page


def column(touch: TouchRun, name: str) -> np.ndarray:
    row, place = touch.run.row(), touch.run.layout.columns[name]
    assert row is not None
    return row[place.where].reshape(place.shape)


def last_forces(touch: TouchRun) -> np.ndarray:
    """Give the sizes of the forces in the last 0.4 s (80, 2) [N]."""
    place = touch.run.layout.columns["finger_force"]
    rows = touch.run.rows(touch.run.tick - 80)[1][:, place.where]
    return np.linalg.norm(rows.reshape(-1, *place.shape), axis=2)


def free(touch: TouchRun) -> bool:
    return bool(np.abs(column(touch, "finger_force")).max() < 1e-3)  # encoders count in steps


def rests(touch: TouchRun) -> bool:
    return bool(np.linalg.norm(column(touch, "objects/object/velocity")) < 1e-3)


def at(page: Page, *places: tuple[float, float]) -> list[tuple[float, float]]:
    """Say where on the page places of the scene are [CSS pixels]."""
    return [tuple(page.evaluate(f"window.graspfx().place({x}, {y})")) for x, y in places]


def pinch(page: Page, x: float, y: float, depth: float, steps: int = 6) -> None:
    """Put two touches on the faces of a cube, and close them."""
    page.touch(at(page, (x - HALF, y), (x + HALF, y)), "touchStart")
    for k in range(1, steps + 1):
        s = HALF - depth * k / steps
        page.touch(at(page, (x - s, y), (x + s, y)), "touchMove")


def middle(touch: TouchRun) -> tuple[float, float]:
    x, y = column(touch, "objects/object/position").tolist()
    return x, y


def share(pixels: Any, colour: str) -> float:
    """Give the share of a picture that has about a colour."""
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)])
    return float((np.abs(pixels.astype(int) - rgb).max(axis=2) < 12).mean())


def test_two_touches_hold_the_cube(page: Page, touch: TouchRun) -> None:
    """The force is that of hand and coupling in series, the page draws it, and two touches that go carry the cube."""
    x, y = middle(touch)
    picture = page.screenshot()
    assert share(picture, "#c3d2e0") > 0.01  # the cube
    assert share(picture[60:300], INTERNAL) == 0.0
    pinch(page, x, y, SQUEEZE)
    (left, _), (right, _) = sorted((each["x"], each["y"]) for each in page.evaluate("window.graspfx().touches"))
    depth = HALF - 0.5 * (right - left)  # to a part of a pixel that the browser rounds
    assert depth == pytest.approx(SQUEEZE, rel=0.01)
    held = SERIES * depth
    until(lambda: np.abs(last_forces(touch) - held).max() < 1e-3 * held)
    force = column(touch, "finger_force")
    assert force[0, 0] > 0.0 > force[1, 0]
    until(lambda: share(page.screenshot()[60:300], INTERNAL) > 0.001)  # two arrows
    until(lambda: share(page.screenshot()[310:390], INTERNAL) > 0.001)  # the chart
    assert share(page.screenshot()[60:300], EXTERNAL) < 2e-4
    for k in range(1, 11):
        s = HALF - SQUEEZE
        page.touch(at(page, (x - s + 0.004 * k, y + 0.002 * k), (x + s + 0.004 * k, y + 0.002 * k)), "touchMove")
    until(lambda: np.allclose(middle(touch), (x + 0.04, y + 0.02), rtol=0.0, atol=5e-4))
    until(lambda: np.abs(last_forces(touch) - held).max() < 0.02 * held)
    page.touch([], "touchEnd")
    until(lambda: free(touch))
    assert page.evaluate("window.graspfx().touches.length") == 0


def test_whoever_leaves_lets_go(browser: Browser, page: Page, touch: TouchRun) -> None:
    """A page that loses the focus, or is closed with fingers on it; another screen watches meanwhile."""
    x, y = middle(touch)
    other = ready(browser, touch)
    pinch(other, x, y, 0.006)
    until(lambda: column(touch, "touching").all())
    page.wait_for("window.graspfx().picture.claimed === 3")
    page.touch(at(page, (x, y)), "touchStart")  # of fingers that another screen has
    assert page.evaluate("window.graspfx().touches.length") == 0
    page.touch([], "touchEnd")
    other.evaluate("window.dispatchEvent(new Event('blur'))")
    until(lambda: free(touch) and rests(touch))
    other.touch([], "touchEnd")
    x, y = middle(touch)
    pinch(other, x, y, 0.006)
    until(lambda: column(touch, "touching").all())
    other.close()
    until(lambda: free(touch))


def test_a_mouse_has_a_second_finger(browser: Browser, page: Page, touch: TouchRun) -> None:
    """Shift mirrors the other finger, so that both squeeze; without it that stays; Space carries it along."""
    page.resize(560, 420)
    x, y = middle(touch)
    start = at(page, (x - HALF, y), (x - HALF + 0.008, y), (x - HALF + 0.028, y))
    shift = {"key": "Shift", "code": "ShiftLeft", "modifiers": 8}
    page.mouse("mouseMoved", *start[0], button="none", buttons=0)
    page.send("Input.dispatchKeyEvent", {"type": "keyDown", **shift})
    for kind, place in (("mousePressed", start[0]), ("mouseMoved", start[1])):
        page.send("Input.dispatchMouseEvent", {
            "type": kind, "x": place[0], "y": place[1], "button": "left", "buttons": 1, "clickCount": 1, "modifiers": 8
        })  # fmt: skip
    page.send("Input.dispatchKeyEvent", {"type": "keyUp", **shift, "modifiers": 0})
    until(lambda: column(touch, "touching").all())
    until(
        lambda: column(touch, "finger_force")[:, 0].min() < -0.15 and column(touch, "finger_force")[:, 0].max() > 0.15
    )
    page.send("Input.dispatchKeyEvent", {"type": "keyDown", "key": " ", "code": "Space"})
    page.mouse("mouseMoved", *start[2])
    until(lambda: middle(touch)[0] > x + 0.015 and column(touch, "touching").all() and rests(touch))
    page.send("Input.dispatchKeyEvent", {"type": "keyUp", "key": " ", "code": "Space"})
    page.mouse("mouseReleased", *start[2])
    until(lambda: free(touch))


def test_a_phone_may_be_turned_and_a_quick_second_touch_has_the_same_finger(page: Page, touch: TouchRun) -> None:
    """Before a picture says that a finger is free, the page that let it go may lead it again."""
    for width, height, scale in ((390, 700, 2.0), (700, 360, 2.0)):
        page.resize(width, height, scale=scale, phone=True)
        page.wait_for(f"document.getElementById('scene').width === {width * scale:.0f}")
        tips = column(touch, "true_position")
        goal = (tips[0, 0] - 0.01, tips[0, 1])
        page.touch(at(page, goal), "touchStart")
        until(lambda goal=goal: np.linalg.norm(column(touch, "true_position")[0] - goal) < 1e-3)  # type: ignore[misc]
        page.touch([], "touchEnd")
    place = at(page, goal)
    for _ in range(10):
        page.touch(place, "touchStart")
        assert page.evaluate("window.graspfx().touches.map(each => each.finger)") == [0]
        page.touch([], "touchEnd")
    until(lambda: not touch.server.has_touches)
    assert touch.server.counts["claim"] == 0


def test_no_order_is_lost_and_the_recording_has_them(browser: Browser, touch: TouchRun) -> None:
    """Every message of a page is in the log once, in its order; what it asked for last is in the recording."""
    page = ready(browser, touch, 420, 320)
    touch.log.entries.clear()
    pinch(page, *middle(touch), 0.008, steps=20)
    until(lambda: touch.server.last == page.evaluate("window.graspfx().number"))
    sent = page.evaluate("window.graspfx().sent")
    time.sleep(0.5)  # for goals on their way
    touch.close()
    assert touch.server.counts["lost"] == 0
    numbers = [entry.order.number for entry in touch.log.entries]
    assert numbers == list(range(1, numbers[-1] + 1)) and numbers[-1] >= sent[-1][0]
    assert set(touch.log.fates()) <= {"applied", "superseded"}
    assert touch._out is not None
    lines = (touch._out / "touches.csv").read_text("utf-8").splitlines()
    assert len(lines) == len(numbers) + 1 and lines[0] == "client,number,kind,finger,x,y,tick,fate"
    recording = Recording.load(touch._out / "recording.h5")
    last = {finger: place for _, _, kind, finger, *place in sent if kind in (1, 2)}
    for finger, guide in enumerate(touch.run.guides):
        values = [each.value for each in recording.changes if each.key == f"finger.{finger}.hand.guide.offset"]
        goal = np.array(last[finger]) - guide.position
        assert min(np.abs(np.array(value).ravel() - goal).max() for value in values) < 1e-12
