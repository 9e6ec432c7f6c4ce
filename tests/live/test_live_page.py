"""The page of a running scene in a browser: its picture, hands on it, orders from it, and what two of them see."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import graspfx as gx
from graspfx.live.live_run import LiveRun
from graspfx.live.sliders import sliders
from graspfx.live.view.live_page import LivePage
from graspfx.recording.record import Recording
from graspfx.show.style import CONTACTS, EXTERNAL, INTERNAL
from tests.support.chromium import Browser, Page, Pixels
from tests.support.view_page import serving
from tests.support.waiting import wait_until as until

pytestmark = pytest.mark.alone

pytest.importorskip("websockets", reason="the page needs websockets: pip install 'graspfx[view]'")

STIFFNESS = "coupling.external.stiffness"
SLIDER = f"graspfx.run.sliders.findIndex((each) => each.key === '{STIFFNESS}')"
TEXT = "document.body.innerText"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("view")


@pytest.fixture(scope="module")
def view(chromium: Browser, folder: Path) -> Iterator[LivePage]:
    """Run a scene whose external stiffness can change, each finger's hand guided, and serve its page."""
    scene = gx.load("paper-waving")
    numbers = [each for each in sliders(scene) if each.key == STIFFNESS]
    names = count()
    with (
        LiveRun(scene, live=[STIFFNESS], guide="hands") as run,
        LivePage(run, numbers, lambda: folder / f"recording-{next(names)}", port=0, tell=lambda _: None) as view,
        serving(view),
    ):
        yield view


@pytest.fixture(scope="module")
def page(chromium: Browser, view: LivePage) -> Iterator[Page]:
    page = opened(chromium, view)
    yield page
    page.close()


def opened(browser: Browser, view: LivePage, width: int = 1200, height: int = 1150, phone: bool = False) -> Page:
    before = view.server.clients
    page = browser.open(view.server.url, width, height, phone=phone)
    page.wait_for("window.graspfx && graspfx.frames > 1 && seen !== null")
    until(lambda: view.server.clients > before)
    return page


def near(pixels: Pixels, colour: str, tolerance: int = 60) -> NDArray[np.bool_]:
    """Mark the pixels that have about a colour, (h, w)."""
    target = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    return np.asarray((np.abs(pixels.astype(int) - target) <= tolerance).all(axis=2))


def press(page: Page, button: str) -> None:
    page.evaluate(f"document.getElementById('{button}').click()")


def part(page: Page, pixels: Pixels, element: str) -> Pixels:
    """Cut the picture of an element out of that of the page."""
    x, y, w, h = page.evaluate(
        f"(b => [b.left, b.top, b.width, b.height].map(Math.round))({element}.getBoundingClientRect())"
    )
    return pixels[y : y + h, x : x + w]


# Before the page of the module is opened: what a browser draws takes both processors.


def test_a_page_whose_program_has_ended_says_so_and_goes_on_with_the_next(browser: Browser, tmp_path: Path) -> None:
    scene = gx.load("reference-1dof", {"engine": "interpreted"})
    with LiveRun(scene) as run:
        with LivePage(run, [], lambda: tmp_path / "none", port=0, tell=lambda _: None) as first, serving(first):
            port = int(first.server.url.rpartition(":")[2])
            page = opened(browser, first)
        page.wait_for("document.getElementById('banner').textContent.includes('does not answer')")
        with LivePage(run, [], lambda: tmp_path / "none", port=port, tell=lambda _: None) as second, serving(second):
            page.wait_for("document.getElementById('banner').hidden && graspfx.playing")


def test_hostile_names_do_nothing(browser: Browser, tmp_path: Path) -> None:
    evil = "</script><img src=x onerror=\"document.title='taken'\">"
    scene = gx.load("reference-1dof", {"title": evil, "engine": "interpreted"})
    with LiveRun(scene, guide="hands") as run:
        page_of = LivePage(run, [], lambda: tmp_path / evil, port=0, tell=lambda _: None)
        with page_of as view, serving(view):
            view._say(evil)
            page = opened(browser, view)
            page.wait_for(f"document.getElementById('remark').textContent === {evil!r}")
            assert page.evaluate("document.title").startswith("</script>")
            assert page.evaluate("document.querySelectorAll('img').length") == 0
            assert page.console_errors == []


def test_the_page_shows_forces_states_and_charts_and_asks_nobody_else(page: Page, view: LivePage, folder: Path) -> None:
    space = "document.getElementById('scene')"

    def shows_squeeze_and_states() -> bool:
        picture = part(page, page.screenshot(), space)
        return near(picture, INTERNAL, 50).sum() > 60 and near(picture, CONTACTS["touch"], 95).sum() > 40

    until(shows_squeeze_and_states)
    until(lambda: near(part(page, page.screenshot(), space), EXTERNAL, 60).sum() > 12)  # it comes and goes with waving
    page.wait_for("graspfx.frames > 100")
    chart = part(page, page.screenshot(folder / "page.png"), "document.querySelector('#charts canvas')")
    assert near(chart, INTERNAL, 20).sum() > 200
    assert near(chart, EXTERNAL, 20).sum() > 50
    assert page.console_errors == []
    assert {url.replace("ws:", "http:").removesuffix("/").removesuffix("/live") for url in page.requests} == {
        view.server.url
    }
    text = page.wait_for(f"{TEXT}.includes('spectral radius') && {TEXT}")
    for words in ("internal force: squeezes", "external force: pushes", "touching fingertip", "running in real time"):
        assert words in text
    assert "of real time" in page.wait_for(f"{TEXT}.includes('of real time') && {TEXT}")


def test_the_numbers_on_the_page_are_those_of_a_recording(page: Page, view: LivePage, folder: Path) -> None:
    """Of a run that is recorded meanwhile: tips, parts of forces, and the depth's least and greatest in a frame."""
    press(page, "record")
    page.wait_for("graspfx.state.recording && graspfx.frames > 40")
    found = page.evaluate("graspfx.frame(30)")
    lines = page.evaluate("charts[1].lines.map((line) => [line.now[30], line.low[30], line.high[30]])")
    until(lambda: view.run.tick > 200)
    press(page, "record")
    run = Recording.load(until(lambda: view.recording is None and view.last))
    k, ticks = found["tick"], page.evaluate("graspfx.run.frames")
    d = run.layout.dimensions
    assert run.true_position is not None
    np.testing.assert_allclose(np.array(found["fingertips"])[:, :d], run.true_position[k], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(np.array(found["external"])[:, :d], run.external_force[k], rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(np.array(found["force"])[:, :d], run.finger_force[k], rtol=1e-5, atol=1e-6)
    depth = 1e3 * np.maximum(0.0, -run.array("gap")[k : k + ticks])
    np.testing.assert_allclose(lines, np.array([depth[0], depth.min(axis=0), depth.max(axis=0)]).T, rtol=1e-5)
    assert page.console_errors == []


def test_a_finger_that_is_dragged_stays_where_it_is_when_its_page_leaves(
    browser: Browser, page: Page, view: LivePage
) -> None:
    other = opened(browser, view)
    box = other.evaluate("(({x, y}) => [x, y])(document.getElementById('space').getBoundingClientRect())")
    for _ in range(20):  # the finger moves: where it was seen it may not be any more
        tip = np.add(box, other.evaluate("graspfx.project(graspfx.frameAt(graspfx.time).fingertips[1]).slice(0, 2)"))
        other.mouse("mousePressed", *tip)
        if other.evaluate("[...drags.values()].some((each) => each.finger === 1)"):
            break
        other.mouse("mouseReleased", *tip)
    for share in np.linspace(0.1, 1.0, 8):
        other.mouse("mouseMoved", tip[0], tip[1] - 40.0 * share)
        time.sleep(0.02)
    goal = until(lambda: view.run.goal(1)[0][1] > 2e-3 and float(view.run.goal(1)[0][1]))
    shown = "graspfx.run.goals[1].offsets[0][1]"
    page.wait_for(f"Math.abs({shown} - {goal}) < 1e-3")  # the other page knows
    other.close()  # in mid-drag
    until(lambda: view.server.clients == 1)
    time.sleep(0.3)
    goal = float(view.run.goal(1)[0][1])
    assert goal > 2e-3
    time.sleep(0.5)
    assert float(view.run.goal(1)[0][1]) == goal
    row, names = view.run.row(), view.run.layout.columns
    assert row is not None
    finger = row[names["true_position"].where].reshape(names["true_position"].shape)[1]
    assert finger[1] > 0.3 * goal  # the object and its friction hold the finger back
    assert view.run.state == "running"
    page.evaluate("document.querySelectorAll('#handles button')[1].focus()")
    page.key("Home")
    until(lambda: not view.run.goal(1)[0].any())


def test_a_slider_changes_the_gain_its_recording_says_at_which_tick_and_both_pages_see_it(
    browser: Browser, page: Page, view: LivePage
) -> None:
    other = opened(browser, view, 390, 844, phone=True)
    press(page, "record")
    until(lambda: view.recording)
    page.wait_for("graspfx.state.recording")
    before = view.run.tick
    left, top, width, height = page.evaluate(
        "(b => [b.left, b.top, b.width, b.height])(document.querySelector('#sliders input').getBoundingClientRect())"
    )
    page.click(left + 0.5 * width, top + 0.5 * height)
    value = until(lambda: view.sliders.values[STIFFNESS] != 30.0 and view.sliders.values[STIFFNESS])
    assert value
    until(lambda: view.run.scene.coupling.external.stiffness == value)
    other.wait_for(f"graspfx.run.values[{SLIDER}] === {value}")
    assert page.evaluate("Number(document.querySelector('#sliders input[type=number]').value)") == pytest.approx(value)
    after = view.run.tick
    other.wait_for("graspfx.state.recording")
    press(other, "record")
    last = until(lambda: view.recording is None and view.last)
    recording = Recording.load(last)
    ticks = [change.tick for change in recording.changes if change.key == STIFFNESS and change.value == value]
    assert len(ticks) == 1
    assert before - 5 <= ticks[0] <= after
    again = gx.replay(recording)
    assert np.array_equal(again.finger_force, recording.finger_force)
    assert other.evaluate("document.documentElement.scrollWidth") <= 390
    other.visit(f"{view.server.url}/recording")
    other.wait_for("window.graspfx && graspfx.frames > 1 && !graspfx.run")
    assert other.evaluate("document.getElementById('about').innerText").startswith("recorded")
    assert page.console_errors == [] and other.console_errors == []


def test_a_number_beyond_the_range_is_taken_back(page: Page, view: LivePage) -> None:
    number = "document.querySelector('#sliders input[type=number]')"
    page.evaluate(f"({number}.value = '1e9', {number}.dispatchEvent(new Event('change')))")
    most = view.sliders.sliders[0].most
    until(lambda: view.sliders.values[STIFFNESS] == most)
    page.evaluate(f"({number}.value = '30', {number}.dispatchEvent(new Event('change')))")
    until(lambda: view.sliders.values[STIFFNESS] == 30.0)
    page.wait_for(f"!{TEXT}.includes('UNSTABLE')")


def test_pause_step_and_reset(page: Page, view: LivePage) -> None:
    press(page, "play")
    until(lambda: view.run.state == "paused")
    page.wait_for("!graspfx.playing")
    time.sleep(0.1)
    tick = view.run.tick
    ticks = page.evaluate("graspfx.run.frames")
    press(page, "forth")
    until(lambda: view.run.tick == tick + ticks)
    time.sleep(0.1)
    assert view.run.tick == tick + ticks
    page.evaluate("document.activeElement.blur()")
    page.key("Home")  # what was a moment ago is looked at, and the run stays as it is
    assert page.evaluate("graspfx.time") < tick * view.run.period - 0.02
    press(page, "play")
    assert page.evaluate("graspfx.time") == pytest.approx(tick * view.run.period, abs=3 * ticks * view.run.period)
    number = view.run.run_number
    press(page, "restart")
    until(lambda: view.run.run_number > number and view.run.state == "running")
    page.wait_for(f"graspfx.playing && {TEXT}.includes('running in real time')")


def test_gains_beyond_the_limit_redden_the_page_before_anybody_waits(page: Page, view: LivePage, folder: Path) -> None:
    page.evaluate(f"graspfx.run.sliders[{SLIDER}].set(graspfx.run.sliders[{SLIDER}].most)")
    page.wait_for("document.getElementById('banner').textContent.includes('UNSTABLE')")
    pixels = page.screenshot(folder / "unstable.png")
    assert near(part(page, pixels, "document.getElementById('banner')"), "#b00020", 20).mean() > 0.6
    page.wait_for("document.querySelector('.margin.red b')?.textContent.startsWith('0.')")
    page.evaluate(f"graspfx.run.sliders[{SLIDER}].set(30)")
    page.wait_for(f"!{TEXT}.includes('UNSTABLE')")
