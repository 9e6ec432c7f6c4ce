"""`graspfx touch`: a page on this machine, a code for a tablet, and scenes that a screen cannot lead."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import graspfx as gx
from graspfx.__main__ import main
from graspfx.errors import RecordingError
from graspfx.live.touch_run import TouchRun
from graspfx.recording.record import Recording
from graspfx.screen import gate

pytest.importorskip("websockets", reason="the page's socket: pip install 'graspfx[touch]'")

SCENE = ["touch", "paper-waving", "--set", "engine=interpreted", "--port", "0"]


def test_it_serves_a_page_and_records(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*SCENE, "--seconds", "0.5", "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert re.match(r"http://127\.0\.0\.1:\d+/\n", text)
    assert "the force is shown, not felt" in text
    recording = Recording.load(tmp_path / "recording.h5")
    assert len(recording) > 0
    assert all("left out" in fault.message for fault in recording.faults)  # on a busy machine
    assert (tmp_path / "touches.csv").read_text("utf-8") == "client,number,kind,finger,x,y,tick,fate\n"
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    assert main([*SCENE, "--out", str(tmp_path)]) == 2
    assert "recording.h5: exists already; choose another --out, or overwrite it" in capsys.readouterr().err
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before
    assert main([*SCENE, "--seconds", "0.3", "--out", str(tmp_path), "--overwrite"]) == 0
    assert (tmp_path / "recording.h5").read_bytes() != before["recording.h5"]


def test_a_log_without_a_recording_is_kept_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "touches.csv"
    log.write_text("of another run\n", "utf-8")
    assert main([*SCENE, "--seconds", "0.2", "--out", str(tmp_path)]) == 2
    assert "touches.csv: exists already; choose another --out, or overwrite it" in capsys.readouterr().err
    with (
        gate.listen("127.0.0.1", 0) as line,
        pytest.raises(RecordingError, match=r"touches\.csv: exists already; choose another place, or pass overwrite"),
    ):
        TouchRun(gx.load("paper-waving"), line, gate.gate_for(line, lan=False), out=tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["touches.csv"]
    assert log.read_text("utf-8") == "of another run\n"
    assert main([*SCENE, "--seconds", "0.2", "--out", str(tmp_path), "--overwrite"]) == 0
    assert log.read_text("utf-8").startswith("client,number,")


def test_a_tablet_gets_a_code(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("segno", reason="it draws the code: pip install 'graspfx[touch]'")
    monkeypatch.setattr(gate, "network_address", lambda: "127.0.0.1")  # this machine may be in no network
    assert main([*SCENE, "--lan", "--seconds", "0.2"]) == 0
    text = capsys.readouterr().out
    assert re.search(r"^http://127\.0\.0\.1:\d+/\?token=[\w-]{32}$", text, re.MULTILINE)
    assert sum("▀" in line or "█" in line or "▄" in line for line in text.splitlines()) > 10


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["touch", "sphere-three-fingers"], "expected a scene with one or two dimensions"),
        (["touch", "paper-waving", "--port", "70000"], "a port from 0"),
        (["touch", "paper-waving", "--seconds", "0"], "a time above zero"),
    ],
)
def test_others_are_refused(words: list[str], text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    assert text in capsys.readouterr().err
