"""A recording that is served as a page: in one part, or in several that are linked."""

from __future__ import annotations

import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from graspfx.__main__ import main
from graspfx.errors import InputError
from graspfx.live.frame import Frames
from graspfx.recording.record import Recording
from graspfx.show.style import INTERNAL
from tests.support.chromium import Browser, Pixels
from tests.support.played import played
from tests.support.recordings import waving

pytest.importorskip("websockets", reason="the page needs websockets: pip install 'graspfx[view]'")

from graspfx.live.view.recording_page import RecordingPage
from tests.support.view_page import serving
from tests.support.waiting import wait_until


def test_a_recording_is_scrubbed_and_played(browser: Browser, tmp_path: Path) -> None:
    """Arrows of a squeeze are there while there is one."""
    played("paper-waving").save(tmp_path / "recording.h5")
    with RecordingPage(Recording.load(tmp_path / "recording.h5"), port=0) as view, serving(view):
        page = browser.open(view.server.url, 1200, 700)
        page.wait_for("window.graspfx && seen !== null")
        page.evaluate("graspfx.go(1.4)")
        wait_until(lambda: blue(page.screenshot()) > 300)
        assert "internal stiffness, kip" in page.evaluate("document.body.innerText")
        page.evaluate("graspfx.go(0)")
        wait_until(lambda: blue(page.screenshot()) < 30)
        page.evaluate("graspfx.play(true)")
        page.wait_for("graspfx.time > 0.1")
        assert page.console_errors == []
        assert page.requests == [f"{view.server.url}/"]


def test_a_long_recording_has_parts_with_the_times_of_the_run(browser: Browser) -> None:
    """Each part has the numbers of its rows, and links to those before and after it."""
    run = played("paper-waving")
    with RecordingPage(run, port=0) as view, serving(view):
        view.rows = 160
        count = -(-len(run) // 160)
        page = browser.open(f"{view.server.url}/2", 1000, 700)
        page.wait_for("window.graspfx && seen !== null")
        assert page.evaluate("[...document.querySelectorAll('#facts a')].map((each) => each.textContent)") == [
            f"Part {each} of {count}" for each in (1, 3)
        ]
        found = page.evaluate("(graspfx.go(1.0), graspfx.frameAt(1.0))")
        assert page.evaluate("graspfx.time") == pytest.approx(1.0, abs=1e-6) and found["tick"] == 200
        np.testing.assert_allclose(found["fingertips"], Frames(run).fingertips[200], rtol=1e-6, atol=1e-8)
        page.evaluate("graspfx.go(0)")
        assert page.evaluate("graspfx.time") == pytest.approx(0.8)
        page.evaluate("document.querySelector('#facts a').click()")
        page.wait_for("location.pathname === '/1' && window.graspfx && graspfx.time === 0")
        assert page.console_errors == []
        for path in ("/0", f"/{count + 1}", "/x", "/1/1", "/99999999999", "/²"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(view.server.url + urllib.parse.quote(path))


def blue(pixels: Pixels) -> int:
    """Count pixels of the internal force's colour where the scene is."""
    r, g, b = (int(INTERNAL[i : i + 2], 16) for i in (1, 3, 5))
    away = np.abs(pixels[130:480].astype(int) - [r, g, b]).max(axis=2)
    return int((away < 60).sum())


def test_an_empty_recording_is_refused() -> None:
    with pytest.raises(InputError, match="at least one tick"):
        RecordingPage(waving(N=0), port=0)


def test_the_command_writes_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, page = tmp_path / "recording.h5", tmp_path / "sub" / "page.html"
    waving(N=40).save(run)
    assert main(["view", str(tmp_path), "--html", str(page)]) == 0
    assert capsys.readouterr().out == f"wrote {page}\n"
    text = page.read_text("utf-8")
    assert main(["view", str(run), "--html", str(page)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main(["view", str(run), "--html", str(page), "--overwrite"]) == 0
    assert page.read_text("utf-8") == text
    assert main(["view", str(run), "--set", "duration=1", "--html", str(page)]) == 2
    assert "is a recording" in capsys.readouterr().err
    assert main(["view", str(tmp_path / "none.h5"), "--html", str(page)]) == 2
    short = ["--set", "duration=0.05", "--set", "engine=interpreted"]
    assert main(["view", "reference-1dof", *short, "--html", str(tmp_path / "run.html")]) == 0
    assert (tmp_path / "run.html").stat().st_size > 20_000


def test_the_command_shows_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    waving(N=40).save(tmp_path / "recording.h5")
    assert main(["view", str(tmp_path), "--port", "0", "--seconds", "0.1"]) == 0
    assert capsys.readouterr().out.startswith("http://127.0.0.1:")
