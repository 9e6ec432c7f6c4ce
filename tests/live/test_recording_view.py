"""A recording on a page of viser: scrubbed and played at its pace, with the same scene as a running one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from graspfx.__main__ import main
from graspfx.errors import InputError
from graspfx.recording.record import Recording
from graspfx.show.style import INTERNAL
from tests.support.chromium import Browser, Pixels
from tests.support.played import played
from tests.support.recordings import waving

pytest.importorskip("viser", reason="viser is not installed: pip install 'graspfx[view]'")

from graspfx.live.recording_view import RecordingView
from tests.support.view_page import serving
from tests.support.waiting import wait_until


@pytest.mark.alone
def test_a_recording_is_scrubbed_and_played(browser: Browser, tmp_path: Path) -> None:
    """Arrows of a squeeze are there while there is one; of a file only the rows that are shown are read."""
    played("paper-waving").save(tmp_path / "recording.h5")
    run = Recording.load(tmp_path / "recording.h5")
    with RecordingView(run, port=0) as view, serving(view):
        page = browser.open(view.server.url, 1200, 700)
        page.wait_for("document.body.innerText.includes('time [s]')")
        view.go(1.4)
        assert view.row == 280
        wait_until(lambda: blue(page.screenshot()) > 300)
        page.wait_for("document.body.innerText.includes('1.4 s')")
        assert "is paused" in page.evaluate("document.body.innerText")
        assert "internal stiffness, kip" in page.evaluate("document.body.innerText")
        view.step(-1)
        assert (view.row, view.playing) == (279, False)
        view.speed = 0.25
        at = view.time
        view.play()
        wait_until(lambda: view.time > at)
        view.pause()
        view.go(0.0)
        wait_until(lambda: blue(page.screenshot()) < 30)
        assert page.console_errors == []
        assert all(url.startswith((view.server.url, view.server.url.replace("http", "ws"))) for url in page.requests)


def test_playing_keeps_its_pace_and_ends() -> None:
    """As long as nobody looked does not count: of two seconds that a picture took, 0.2 s."""
    with RecordingView(waving(N=400), port=0) as view:
        view.speed = 0.25
        view.play()
        for elapsed, passed in ((0.1, 0.025), (2.0, 0.05)):
            before = view.time
            view._advance(elapsed)
            assert view.time - before == pytest.approx(passed)
        view.pause()
        view._advance(0.1)
        assert view.time == pytest.approx(0.075)
        view.go(99.0)
        assert view.time == view.end == pytest.approx(1.995)
        view._advance(0.1)
        assert view.time == view.end
        view.play()
        assert view.time == 0.0 and view.playing
        view.go(view.end - 0.001)
        view._advance(0.1)
        assert view.time == view.end and not view.playing


def blue(pixels: Pixels) -> int:
    """Count pixels of the internal force's colour where the scene is, between the panels."""
    r, g, b = (int(INTERNAL[i : i + 2], 16) for i in (1, 3, 5))
    away = np.abs(pixels[:, 345:855].astype(int) - [r, g, b]).max(axis=2)
    return int((away < 60).sum())


def test_an_empty_recording_is_refused() -> None:
    with pytest.raises(InputError, match="at least one tick"):
        RecordingView(waving(N=0), port=0)


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
    assert "has been run" in capsys.readouterr().err
    assert main(["view", str(tmp_path / "none.h5"), "--html", str(page)]) == 2
    short = ["--set", "duration=0.05", "--set", "engine=interpreted"]
    assert main(["view", "reference-1dof", *short, "--html", str(tmp_path / "run.html")]) == 0
    assert (tmp_path / "run.html").stat().st_size > 20_000


def test_the_command_shows_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    waving(N=40).save(tmp_path / "recording.h5")
    assert main(["view", str(tmp_path), "--port", "0", "--seconds", "0.1"]) == 0
    assert capsys.readouterr().out.startswith("http://127.0.0.1:")
