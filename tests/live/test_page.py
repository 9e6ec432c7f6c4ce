"""The page of a recording in a browser: its numbers, its pictures, hands on it, and nothing from outside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.live.frame import STATES, Frames
from graspfx.live.page.document import write_page
from graspfx.live.page.story import RESOLUTION
from graspfx.live.scenery import SLAB, scenery
from graspfx.recording.header import KeyChange
from graspfx.recording.record import Recording
from graspfx.show.style import CONTACTS, EXTERNAL, INTERNAL
from tests.support.chromium import Browser, Page, Pixels
from tests.support.optional import require
from tests.support.played import SECONDS, played
from tests.support.recordings import waving

BLUE, VERMILION = INTERNAL, EXTERNAL
DRAWN = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"  # what was ordered is seen

ARROWS = """(box => graspfx.arrows().map(each => {
    const [x, y] = graspfx.project(each.tip.map((value, i) => (value + each.tail[i]) / 2));
    return {...each, middle: [box.left + x, box.top + y]};
}))(document.getElementById('scene').getBoundingClientRect())"""


def opened(browser: Browser, folder: Path, run: Recording, **choices: Any) -> Page:
    file = write_page(run, folder / "page.html", overwrite=True)
    return browser.open(file.as_uri(), **choices)


def go(page: Page, time: float) -> Pixels:
    """Show a time, and take the picture."""
    page.evaluate(f"graspfx.go({time})")
    page.evaluate(DRAWN)
    return page.screenshot()


def hue(colour: str) -> NDArray[np.float64]:
    rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], dtype=float)
    return np.asarray((rgb - rgb.mean()) / np.linalg.norm(rgb - rgb.mean()))


def is_of(pixels: Pixels, colour: str) -> NDArray[np.bool_]:
    """Tell which pixels have the hue of a colour, lit or in the shade, and not faintly."""
    away = pixels.astype(float) - pixels.mean(axis=-1, keepdims=True)
    strength = np.linalg.norm(away, axis=-1)
    return np.asarray((strength > 30.0) & ((away @ hue(colour)) > 0.97 * strength))


def place_of(page: Page, point: Any) -> tuple[float, float]:
    """Find where a point of the scene is seen in the window."""
    x, y, _ = page.evaluate(f"graspfx.project({[float(each) for each in point]})")
    left, top = page.evaluate("(box => [box.left, box.top])(document.getElementById('scene').getBoundingClientRect())")
    return left + x, top + y


def near(pixels: Pixels, x: float, y: float, reach: int = 4) -> Pixels:
    i, j = round(y), round(x)
    return pixels[max(i - reach, 0) : i + reach + 1, max(j - reach, 0) : j + reach + 1]


@pytest.mark.parametrize("name", SECONDS)
def test_a_page_shows_what_the_recording_says(browser: Browser, tmp_path: Path, name: str) -> None:
    """Numbers are right to the bit of a float; arrows are where they should be, in their colours and lengths."""
    run = played(name)
    page = opened(browser, tmp_path, run, width=640, height=560)
    frames = Frames(run, scenery(run.header, run.layout).apart)
    rows, count = page.evaluate("[Math.round(graspfx.story.step * 1e9), graspfx.story.frames]")
    rows = round(rows * 1e-9 / run.row_period)
    blue = vermilion = 0
    for k in (0, count // 2, count - 1):
        row, shown = k * rows, page.evaluate(f"graspfx.frame({k})")
        require_same(frames, row, shown)
        pixels = go(page, row * run.row_period)
        assert page.evaluate("graspfx.time") == pytest.approx(frames.time[row], abs=1e-9)
        scale = page.evaluate("graspfx.story.arrow.scale")
        for arrow in page.evaluate(ARROWS):
            length = np.linalg.norm(np.subtract(arrow["tip"], arrow["tail"]))
            force = require(frames.parts)[arrow["colour"] != BLUE][row]
            assert length == pytest.approx(scale * np.linalg.norm(force[arrow["finger"]]), rel=1e-5)
            seen = is_of(near(pixels, *arrow["middle"]), arrow["colour"]).any()
            blue += int(seen and arrow["colour"] == BLUE)
            vermilion += int(seen and arrow["colour"] == VERMILION)
    assert blue >= 2
    assert vermilion >= (name == "paper-waving")  # the others are not pushed in so short a while
    assert page.console_errors == []
    assert page.requests == [page.evaluate("location.href")]


def require_same(frames: Frames, row: int, shown: Mapping[str, Any]) -> None:
    """Require that the page has the numbers of a row's frame, each rounded to 24 bits."""

    def same(values: Any, exact: Any) -> None:
        values, exact = np.array(values, dtype=float), np.array(exact, dtype=float)
        seen = np.isfinite(exact)
        assert np.array_equal(np.isfinite(values), seen)
        assert (np.abs(values - exact)[seen] <= RESOLUTION * np.abs(exact)[seen] + 1e-45).all()

    same(shown["fingertips"], frames.fingertips[row])
    same(shown["contacts"], frames.contacts[row])
    for name, part in zip(("internal", "external"), require(frames.parts), strict=True):
        same(shown[name], part[row])
    force = require(frames.force)[row]
    assert np.allclose(shown["force"], force, rtol=0.0, atol=3.0 * RESOLUTION * np.abs(force).max(initial=1.0))
    assert shown["states"] == [STATES[state] for state in frames.states[row]]
    for (position, wxyz), each in zip(frames.poses.values(), shown["objects"], strict=True):
        same(each["position"], position[row])
        same(each["wxyz"], wxyz[row])


def test_the_object_is_seen_where_it_is(browser: Browser, tmp_path: Path) -> None:
    """The cube waves over 50 mm: the middle of its front's pixels is where the page projects it, at every time."""
    run = waving_cube()
    page = opened(browser, tmp_path, run)
    page.evaluate("(graspfx.camera.azimuth = -Math.PI / 2, graspfx.camera.elevation = 0, 1)")  # from before the plane
    page.evaluate("(document.getElementById('names').checked = false)")
    offsets = []
    for time in (0.0, 0.25, 0.5, 1.5):
        pixels = go(page, time).astype(int)
        front = np.array([0.0, 0.0, 0.5 * SLAB * page.evaluate("graspfx.story.extent")])
        x, y = place_of(page, Frames(run).poses["object0"][0][round(time / run.row_period)] + front)
        colour = pixels[round(y) + 40, round(x)]  # of its front, beside what is drawn of the fingers
        rows, columns = np.nonzero(np.abs(pixels[90:590, 20:980] - colour).max(axis=2) < 4)
        assert len(rows) > 4000
        offsets.append((20 + np.median(columns) - x, 90 + np.median(rows) - y))
    assert np.ptp([place_of(page, pose) for pose in ((-0.05, 0, 0), (0.05, 0, 0))], axis=0)[0] > 300
    assert np.abs(offsets).max() < 3.0


def waving_cube() -> Recording:
    run = waving(N=400)
    shape = {"kind": "box", "size": [0.04, 0.04]}
    return Recording(run.rows.copy(), run.layout, replace(run.header, scene_table={
        "dimensions": 2, "object": {"name": "object0", "shape": shape}
    }))  # fmt: skip


def test_the_chart_and_the_fingertips_have_their_colours(browser: Browser, tmp_path: Path) -> None:
    run = played("mug")
    page = opened(browser, tmp_path, run, height=1000)
    pixels = go(page, 0.44)
    frames = Frames(run)
    squeeze = frames.modes["object"].mean_squeeze
    for k in range(24, 96, 8):  # in the chart: the line of the squeeze goes through its values
        x, y = page.evaluate(f"graspfx.chartPlace(0, {squeeze[k]}, {k * run.row_period})")
        assert is_of(near(pixels, x, y, 2), BLUE).any(), k
        assert not is_of(near(pixels, x, y - 14, 2), BLUE).any(), k
    x, top = page.evaluate("graspfx.chartPlace(0, 0.0, 0.44)")
    assert (near(pixels, x, top - 5, 1).astype(int).sum(axis=2) < 240).any()  # the cursor
    k = 88
    assert {STATES[state] for state in frames.states[k]} <= {"stick", "slide"}
    tips = [
        i for i in range(5) if is_of(near(pixels, *place_of(page, frames.fingertips[k, i])), CONTACTS["stick"]).any()
    ]
    assert len(tips) >= 3
    place = page.evaluate("graspfx.chartPlace(0, 0.5, 0.2)")
    page.click(*place)
    assert page.evaluate("graspfx.time") == pytest.approx(0.2, abs=0.005)


def test_hands_play_scrub_and_turn(browser: Browser, tmp_path: Path) -> None:
    page = opened(browser, tmp_path, played("paper-waving"))
    assert page.evaluate("[graspfx.playing, graspfx.time]") == [False, 0]
    page.key(" ")
    page.wait_for("graspfx.time > 0.1")
    page.key(" ")
    assert page.evaluate("graspfx.playing") is False
    time = page.evaluate("graspfx.time")
    page.evaluate(DRAWN)
    assert page.evaluate("graspfx.time") == time
    page.key("Home")
    page.key("ArrowRight")
    page.key("ArrowRight")
    page.key("ArrowLeft")
    assert page.evaluate("graspfx.time") == pytest.approx(0.02, abs=1e-9)
    page.key("End")
    assert page.evaluate("graspfx.time") == pytest.approx(1.98, abs=1e-9)
    page.evaluate("(document.getElementById('slider').value = 1.2,"
                  "document.getElementById('slider').dispatchEvent(new Event('input')))")  # fmt: skip
    assert page.evaluate("graspfx.time") == pytest.approx(1.2, abs=1e-9)
    page.evaluate(DRAWN)
    assert page.evaluate("document.getElementById('clock').textContent").startswith("1.200 s")
    page.evaluate("(s => (s.value = '0.1', s.dispatchEvent(new Event('change'))))(document.getElementById('speed'))")
    before = page.evaluate("(graspfx.play(true), performance.now())")
    page.wait_for("graspfx.time > 1.24")
    passed = 1e-3 * (page.evaluate("(graspfx.play(false), performance.now())") - before)
    assert page.evaluate("graspfx.time") - 1.2 <= 0.1 * passed + 0.005
    azimuth, zoom = page.evaluate("[graspfx.camera.azimuth, graspfx.camera.zoom]")
    page.drag([(500, 300), (540, 310), (600, 320)])
    assert page.evaluate("graspfx.camera.azimuth") == pytest.approx(azimuth - 0.8, abs=0.02)
    page.wheel(500, 300, 200)
    page.wait_for(f"graspfx.camera.zoom > {1.1 * zoom}")
    page.drag([(500, 300), (560, 300)], button="right")
    assert page.evaluate("graspfx.camera.target[0] != 0.5 * (graspfx.story.bounds[0][0] + graspfx.story.bounds[1][0])")
    page.key("r")
    assert page.evaluate("[graspfx.camera.azimuth, graspfx.camera.zoom]") == [azimuth, 1]
    assert page.console_errors == []


def test_a_phone_shows_all_of_it(browser: Browser, tmp_path: Path) -> None:
    run = played("two-objects")
    page = opened(browser, tmp_path, run, width=360, height=740, scale=2.0, phone=True, dark=True)
    page.evaluate(DRAWN)
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    names = page.evaluate("""[...document.querySelectorAll('button, input, select, canvas[role=img]')].map(each =>
        each.getAttribute('aria-label') || each.textContent.trim() || each.closest('label')?.textContent.trim())""")
    assert len(names) >= 9
    assert all(names)
    sizes = page.evaluate(
        "[...document.querySelectorAll('button:not([hidden])')].map(each => each.getBoundingClientRect().height)"
    )
    assert min(sizes) >= 36
    assert page.screenshot()[1300, 5].max() < 60  # it is dark
    zoom, azimuth = page.evaluate("[graspfx.camera.zoom, graspfx.camera.azimuth]")
    page.touch([(180, 250)], "touchStart")
    page.touch([(220, 250)], "touchMove")
    page.touch([], "touchEnd")
    assert page.evaluate("graspfx.camera.azimuth") == pytest.approx(azimuth - 0.32, abs=0.05)
    page.touch([(150, 250), (210, 250)], "touchStart")
    page.touch([(120, 250), (240, 250)], "touchMove")
    page.touch([], "touchEnd")
    assert page.evaluate("graspfx.camera.zoom") == pytest.approx(0.5 * zoom, rel=0.1)
    assert page.console_errors == []


HOSTILE = "</script><script>window.bad = 1</script><img src=x onerror='window.bad = 1'> \u2028 ${bad} {story}"


def test_names_of_others_stay_text(browser: Browser, tmp_path: Path) -> None:
    run = waving_cube()
    names = ("<b onclick=bad>a</b>", "--><script>bad = 1</script>")
    table = {**run.header.scene_table, "coupling": {"external": {"stiffness": HOSTILE}}}
    header = replace(run.header, title=HOSTILE, scene=HOSTILE, scene_table=table)
    changes = (KeyChange(100, HOSTILE, HOSTILE),)
    hostile = Recording(
        run.rows.copy(), replace(run.layout, fingers=names), header, replace(run.outcome, changes=changes)
    )
    page = opened(browser, tmp_path, hostile)
    page.evaluate(DRAWN)
    assert page.evaluate("typeof bad") == "undefined"
    assert page.evaluate("document.getElementById('title').textContent") == HOSTILE
    assert page.evaluate("document.querySelectorAll('img, b[onclick]').length") == 0
    assert page.evaluate("document.title").startswith("</script>")
    assert page.requests == [page.evaluate("location.href")]
    assert page.console_errors == []
    page.evaluate("document.body.insertAdjacentHTML('beforeend', '<img src=x onerror=\"window.bad = 1\">')")
    page.evaluate(DRAWN)
    assert page.evaluate("typeof bad") == "undefined"  # the page lets nobody's script run but its own


def test_values_change_with_time(browser: Browser, tmp_path: Path) -> None:
    run = played("paper-waving")
    change = KeyChange(200, "coupling.internal.stiffness", 80.0)
    changed = Recording(run.rows.copy(), run.layout, run.header, replace(run.outcome, changes=(change,)))
    page = opened(browser, tmp_path, changed)
    cell = "document.querySelector('th[title=\"coupling.internal.stiffness\"]').nextSibling"
    words = []
    for time in (0.98, 1.0, 0.5):
        go(page, time)
        words.append(page.evaluate(f"[{cell}.textContent, {cell}.className]"))
    assert words == [["70 N/m", ""], ["80 N/m", "changed"], ["70 N/m", ""]]


def test_without_graphics_in_space_the_chart_still_works(browser: Browser, tmp_path: Path) -> None:
    blind = """const original = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
          return kind.startsWith('webgl') ? null : original.call(this, kind, ...rest); };"""
    page = opened(browser, tmp_path, played("paper-waving"), before=blind)
    pixels = go(page, 1.0)
    assert page.evaluate("document.getElementById('missing').hidden") is False
    assert page.evaluate("document.getElementById('missing').getBoundingClientRect().height") > 20
    squeeze = next(iter(Frames(played("paper-waving")).modes.values())).mean_squeeze[200]
    x, y = page.evaluate(f"graspfx.chartPlace(0, {squeeze}, 1.0)")
    assert is_of(near(pixels, x, y), BLUE).any()
    assert page.console_errors == []
