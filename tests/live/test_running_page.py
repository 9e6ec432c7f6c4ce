"""Pages that run a scene by themselves: the rows that they compute, hands on them, and what they do not do."""

from __future__ import annotations

import re
from base64 import b64decode, b64encode
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.build import build
from graspfx.errors import InputError
from graspfx.live.guides import guided_scene
from graspfx.live.page.running import module, running
from graspfx.recording.record import Recording
from tests.support.chromium import Browser, Page
from tests.support.waiting import wait_until

pytest.importorskip("ziglang", reason="the module for browsers is compiled with ziglang: pip install 'graspfx[page]'")

CLOSE = 1e-9  # [m, N, m/s]: gaps of a fade that follow from stiffnesses are rounded otherwise in a page, after a second
SCENES = Path(__file__).parents[2] / "scenes"
NAMES = sorted(
    file.stem.replace("_", "-")
    for file in SCENES.iterdir()
    if file.suffix in (".toml", ".py") and file.stem != "two-objects"
)
GAIN = "coupling.internal.stiffness"


def opened(browser: Browser, folder: Path, scene: gx.Scene, **options: Any) -> Page:
    """Write a page, open it from its file, and wait for its first picture."""
    path = scene.to_html(folder / "page.html", **options)
    page = browser.open(path.as_uri(), 1000, 900)
    page.wait_for("window.graspfx && graspfx.frames > 0 && seen !== null")
    return page


def downloaded(page: Page, folder: Path, seconds: float) -> Recording:
    """Record from the start for so long, and load what the page gives."""
    page.evaluate("document.getElementById('record').click()")
    page.wait_for(f"graspfx.state.recording && graspfx.state.tick * graspfx.run.period > {seconds}")
    return saved(page, folder)


def saved(page: Page, folder: Path) -> Recording:
    """Pause, and load what the page gives for a download."""
    page.allow_downloads(folder)
    page.evaluate("graspfx.play(false)")
    page.wait_for("!graspfx.playing")
    page.evaluate("document.getElementById('download').click()")
    file = folder / "recording.h5.part"
    wait_until(lambda: file.is_file() and not list(folder.glob("*.crdownload")))
    return Recording.load(file)


@pytest.mark.parametrize("name", ["paper-waving", "mug"])
def test_the_rows_of_a_page_are_those_of_a_run(name: str, browser: Browser, tmp_path: Path) -> None:
    """To the bit: WebAssembly and native code compute the same."""
    page = opened(browser, tmp_path, gx.load(name))
    recording = downloaded(page, tmp_path, 1.0)
    ticks = len(recording)
    assert ticks * recording.period >= 1.0 and recording.outcome.engine == "webassembly"
    run = gx.run(guided_scene(gx.load(name)), duration=ticks * recording.period)
    np.testing.assert_array_equal(recording.rows, run.rows)
    external = page.evaluate("graspfx.frame(graspfx.frames - 2).external")
    k = page.evaluate("graspfx.frame(graspfx.frames - 2).tick")
    wanted = np.zeros((len(external), 3))
    wanted[:, : recording.layout.dimensions] = recording.external_force[k]
    np.testing.assert_allclose(external, wanted, atol=1e-6 * np.abs(recording.finger_force).max())
    assert page.console_errors == [] and page.requests == [(tmp_path / "page.html").as_uri()]


def test_a_slider_shows_its_limit_at_the_end_of_its_range_too() -> None:
    """The range of a stiffness ends at 1.5 times its limit: limits were looked up before, at 4 times the value."""
    scene = guided_scene(gx.load("sphere-three-fingers"))
    limit = next(row.limit for row in gx.certify(scene)[0].limits if row.mode == "internal")
    (slider,) = [each for each in running(scene, 10, {})["sliders"] if each["key"] == GAIN]
    assert slider["most"] > limit > 4.0 * slider["value"]
    ((low, high),) = slider["margin"]
    assert high == slider["most"] and low == pytest.approx(limit, rel=0.02)  # the squeeze is that of the value


def test_a_red_band_is_drawn_where_a_value_is_not_stable(browser: Browser, tmp_path: Path) -> None:
    """Beneath the slider: browsers draw no background of the slider itself."""
    page = opened(browser, tmp_path, gx.load("paper-waving"))
    page.evaluate("document.getElementById('sliders').scrollIntoView()")
    place = """(() => { const band = [...document.querySelectorAll('.band')].find((each) => each.style.backgroundImage);
        const { right, top, bottom } = band.getBoundingClientRect(); return [right, top, bottom]; })()"""
    right, top, bottom = page.evaluate(place)
    red, green, blue = page.screenshot()[round(0.5 * (top + bottom)), round(right) - 5]
    assert red > 200 and green < 190 and blue < 190  # --unstable


def test_a_slider_writes_what_a_session_sets(browser: Browser, tmp_path: Path) -> None:
    """In the tick that the recording names, with what follows from the gain; the replay has the same forces."""
    scene = gx.load("soft-pads")
    page = opened(browser, tmp_path, scene)
    page.evaluate("document.getElementById('record').click()")
    page.wait_for("graspfx.state.recording && graspfx.state.tick > 100")
    page.evaluate("graspfx.run.sliders.find((each) => each.key === 'coupling.external.stiffness').set(150)")
    at = page.evaluate("graspfx.state.tick")
    page.wait_for(f"graspfx.state.tick > {at} + 200")
    recording = saved(page, tmp_path)
    changes = [each for each in recording.changes if each.key == "coupling.external.stiffness"]
    assert [each.value for each in changes] == [150]
    with gx.open(guided_scene(scene), live=["coupling.external.stiffness"]) as session:
        session.step(changes[0].tick)
        session.set("coupling.external.stiffness", 150.0)
        session.step(len(recording) - changes[0].tick)
    assert np.nanmax(np.abs(recording.rows - session.recording.rows)) < CLOSE


def test_a_recording_that_was_stopped_is_kept(browser: Browser, tmp_path: Path) -> None:
    """Through a restart and further changes, until the next recording begins."""
    page = opened(browser, tmp_path, gx.load("reference-1dof"))
    page.evaluate("document.getElementById('record').click()")
    page.wait_for("graspfx.state.recording && graspfx.state.tick > 50")
    page.evaluate("document.getElementById('record').click()")
    page.wait_for("!graspfx.state.recording")
    rows = page.evaluate("graspfx.state.recorded")
    page.evaluate("document.getElementById('restart').click()")
    page.wait_for("graspfx.playing && graspfx.state.tick > 20")
    page.evaluate("graspfx.run.sliders[0].set(20)")
    recording = saved(page, tmp_path)
    assert rows > 50 and len(recording) == rows
    assert recording.outcome.complete and not recording.changes


def test_fingers_are_dragged_by_mouse_touch_and_keys(browser: Browser, tmp_path: Path) -> None:
    page = opened(browser, tmp_path, gx.load("paper-waving"))
    page.evaluate("graspfx.play(false)")
    page.wait_for("!graspfx.playing")
    box = page.evaluate("(({x, y}) => [x, y])(document.getElementById('space').getBoundingClientRect())")
    tips = [np.add(box, page.evaluate(f"graspfx.project(graspfx.frameAt(graspfx.time).fingertips[{i}]).slice(0, 2)"))
            for i in range(2)]  # fmt: skip
    (x, y), (u, v) = tips
    page.drag([(x, y), (x + 20, y), (x + 40, y)])
    goal = page.evaluate("graspfx.run.goals[0].offsets[0]")
    assert goal[0] > 1e-3 and page.evaluate("graspfx.run.goals[1].offsets[0]") == [0, 0]
    page.touch({0: (x, y), 1: (u, v)}, "touchStart")
    page.touch({0: (x - 30, y), 1: (u + 30, v)}, "touchMove")
    page.touch({}, "touchEnd")
    first, second = page.evaluate("graspfx.run.goals.map((each) => each.offsets[0][0])")
    assert first < goal[0] and second > 1e-3
    up = "graspfx.run.goals[1].offsets[0][1]"
    before = page.evaluate(up)
    page.evaluate("document.querySelectorAll('#handles button')[1].focus()")
    page.key("ArrowUp", "ArrowUp")
    assert page.evaluate(up) == pytest.approx(before + 1e-3)
    page.evaluate("graspfx.play(true)")
    page.wait_for("graspfx.playing")
    before = page.evaluate("graspfx.state.tick")
    page.wait_for(f"graspfx.state.tick > {before} + 100")
    assert page.console_errors == []


def test_a_whole_hand_moves_with_its_fingers_as_they_are(browser: Browser, tmp_path: Path) -> None:
    """By keys and with shift: a finger that has been moved aside stays aside."""
    page = opened(browser, tmp_path, gx.load("mug"))
    page.evaluate("graspfx.play(false)")
    page.wait_for("!graspfx.playing")
    press = "document.querySelectorAll('#handles button')[{}].focus()"
    page.evaluate(press.format(2))
    page.key("ArrowUp", "ArrowUp")
    page.evaluate(press.format(0))
    page.key("ArrowUp", "ArrowUp")
    assert page.evaluate("graspfx.run.goals[0].offsets.map((each) => each[1])") == pytest.approx(
        [1e-3, 2e-3, *[1e-3] * 3]
    )
    x, y = np.add(
        page.evaluate("(({x, y}) => [x, y])(document.getElementById('space').getBoundingClientRect())"),
        page.evaluate("graspfx.project(graspfx.frameAt(graspfx.time).fingertips[2]).slice(0, 2)"),
    )
    before = np.array(page.evaluate("graspfx.run.goals[0].offsets"))
    page.mouse("mousePressed", x, y, modifiers=8)
    page.mouse("mouseMoved", x + 15, y, modifiers=8)
    page.mouse("mouseReleased", x + 15, y, modifiers=8)
    moved = np.array(page.evaluate("graspfx.run.goals[0].offsets")) - before
    assert np.ptp(moved, axis=0).max() < 1e-12 and np.abs(moved).max() > 1e-3
    page.evaluate(press.format(0))
    page.key("Home")
    assert not np.any(page.evaluate("graspfx.run.goals[0].offsets"))


def test_a_fault_ends_the_run_with_its_message(browser: Browser, tmp_path: Path) -> None:
    page = opened(browser, tmp_path, gx.load("reference-1dof"))
    page.evaluate("document.getElementById('record').click()")
    page.wait_for("graspfx.state.recording && graspfx.state.tick > 20")
    entries = "graspfx.run.handles[0].goals.map((place) => [place, NaN])"
    page.evaluate(f"tell('write', {{ entries: {entries}, values: [['mark', 'NaN']] }})")
    text = page.wait_for("!document.getElementById('banner').hidden && document.getElementById('banner').textContent")
    assert "finite" in text or "diverged" in text
    recording = saved(page, tmp_path)
    assert [str(each.message) for each in recording.faults] == [text]
    assert (recording.finger_force[-1] == 0.0).all()


def test_a_force_beyond_the_bound_is_told_as_it_is_natively(browser: Browser, tmp_path: Path) -> None:
    """The same force and the same bound; the page does not name the gain that contributes most."""
    scene = gx.load("paper-waving", {"coupling.force_bound": 0.1})
    page = opened(browser, tmp_path, scene)
    text = page.wait_for("!document.getElementById('banner').hidden && document.getElementById('banner').textContent")
    native = str(gx.run(guided_scene(scene)).faults[0].message)
    found = re.match(r"the law gives a finger on object (\S+ N, above coupling.force_bound = 0.1 N)", text)
    assert found is not None and native.startswith(f"the law gives a finger {found[1]}")


@pytest.mark.parametrize(
    ("name", "overrides", "words"),
    [
        ("reference-1dof", {"object.dynamics": "bullet"}, "other software"),
        ("paper-waving", {"finger.*.device": {"name": "touch-screen"}, "finger.*.hand": None}, "plain Python"),
    ],
)
def test_a_scene_with_other_parts_is_refused(
    name: str, overrides: Mapping[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=words) as error:
        gx.load(name, overrides).to_html(tmp_path / "page.html")
    assert "--html" in str(error.value) and not (tmp_path / "page.html").exists()


def test_hostile_names_do_nothing(browser: Browser, tmp_path: Path) -> None:
    evil = "</script><img src=x onerror=\"document.title='taken'\">"
    scene = gx.load("paper-waving", {"title": evil})
    page = opened(browser, tmp_path, scene, presets={evil: {GAIN: 40.0}})
    assert page.evaluate("document.title").startswith("</script>")
    assert page.evaluate("document.getElementById('title').textContent") == evil
    assert page.evaluate("document.querySelector('#presets button').textContent") == evil
    page.evaluate("document.querySelector('#presets button').click()")
    assert page.evaluate("graspfx.run.values[2]") == 40
    page.resize(390, 844, phone=True)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.console_errors == [] and len(page.requests) == 1


def test_a_preset_has_sliders(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="keys with a slider"):
        gx.load("paper-waving").to_html(tmp_path / "page.html", presets={"a": {"period": 0.001}})
    with pytest.raises(InputError, match=f"{GAIN} from 5 to 500"):
        gx.load("paper-waving").to_html(tmp_path / "page.html", presets={"a": {GAIN: 1e6}})


MODULE = """<!DOCTYPE html><title>steps</title><script>
const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
const { exports } = new WebAssembly.Instance(new WebAssembly.Module(bytes("%s")));
function rowsOf(text, world, width, ticks) {
  const arena = bytes(text), at = (exports.__heap_base.value + 15) & ~15, rows = at + arena.length;
  const missing = rows + 8 * width * ticks - exports.memory.buffer.byteLength;
  if (missing > 0) exports.memory.grow(Math.ceil(missing / 65536));
  new Uint8Array(exports.memory.buffer).set(arena, at);
  exports.graspfx_entry(at, rows, BigInt(world), 0n, BigInt(ticks), 0n);
  const found = new Uint8Array(exports.memory.buffer, rows, 8 * width * ticks);
  let letters = "";
  for (const each of found) letters += String.fromCharCode(each);
  return btoa(letters);
}
</script>"""


@pytest.mark.parametrize("name", NAMES)
def test_every_scene_computes_the_bits_of_native_code_in_a_browser(name: str, browser: Browser, tmp_path: Path) -> None:
    """All built-in scenes but the one with PyBullet, by the module alone."""
    page = tmp_path / "module.html"
    page.write_text(MODULE % b64encode(module()).decode(), encoding="ascii")
    scene = gx.load(name).replace({"record.every": 1, "record.columns": []})
    ticks = min(200, round(scene.duration / scene.period))
    with build(scene) as servo:
        arena, width = servo.arena, servo.layout.width
        start = arena.memory.floats[: arena.memory.used].tobytes()
        opened = browser.open(page.as_uri(), 400, 300)
        text = opened.evaluate(f"rowsOf('{b64encode(start).decode()}', {arena.offset}, {width}, {ticks})")
    rows = np.frombuffer(b64decode(text)).reshape(ticks, width)
    np.testing.assert_array_equal(rows, gx.run(scene, duration=ticks * scene.period).rows)
