"""`graspfx stream`: an address with a token, a recording, and what is refused."""

from __future__ import annotations

import os
import re
import signal
from pathlib import Path
from typing import Any

import pytest

from graspfx.__main__ import main
from graspfx.live.live_run import LiveRun
from graspfx.recording.record import Recording
from tests.support.servo_wires import servo_of

pytest.importorskip("websockets", reason="the stream's socket: pip install 'graspfx[touch]'")

SCENE = ["stream", "paper-waving", "--set", "engine=interpreted", "--port", "0"]


def test_it_prints_its_address_and_records(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*SCENE, "--seconds", "0.4", "--out", str(tmp_path)]) == 0
    assert re.search(r"^ws://127\.0\.0\.1:\d+/stream\?token=[\w-]{32}$", capsys.readouterr().out, re.MULTILINE)
    recording = Recording.load(tmp_path)
    assert len(recording) > 20 and not recording.faults
    before = (tmp_path / "recording.h5").read_bytes()
    assert main([*SCENE, "--out", str(tmp_path)]) == 2
    assert "recording.h5: exists already; choose another --out, or overwrite it" in capsys.readouterr().err
    assert (tmp_path / "recording.h5").read_bytes() == before
    assert main([*SCENE, "--seconds", "0.2", "--out", str(tmp_path), "--overwrite"]) == 0
    assert (tmp_path / "recording.h5").read_bytes() != before


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="processes of Linux")
@pytest.mark.parametrize("command", ["stream", "touch", "view"])
def test_a_run_whose_process_dies_has_a_fault(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = LiveRun._open

    def strike(run: LiveRun, *arguments: Any, **more: Any) -> None:
        begin(run, *arguments, **more)
        os.kill(servo_of(os.getpid()), signal.SIGKILL)

    monkeypatch.setattr(LiveRun, "_open", strike)
    record = [] if command == "view" else ["--out", str(tmp_path)]  # a touched scene without a recording begins again
    assert main([command, *SCENE[1:], "--seconds", "4", *record]) == 3
    assert "the servo's process was ended by SIGKILL" in "".join(capsys.readouterr())


def test_the_token_may_come_from_the_environment(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An argument can be read by everybody on the machine; where both are given it is the argument's."""
    monkeypatch.setenv("GRASPFX_TOKEN", "of-the-environment")
    assert main([*SCENE, "--seconds", "0.1"]) == 0
    assert "?token=of-the-environment\n" in capsys.readouterr().out
    assert main([*SCENE, "--seconds", "0.1", "--token", "of-the-command-line"]) == 0
    assert "?token=of-the-command-line\n" in capsys.readouterr().out
    monkeypatch.setenv("GRASPFX_TOKEN", "short")
    assert main(SCENE) == 2
    assert "16 letters" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--seconds", "0"], "a time above zero"),
        (["--rate", "0.5"], "a rate of 1 to 120 Hz"),
        (["--token", "short"], "16 letters"),
        (["--origin", "*"], "the address of a site"),
        (["--port", "70000"], "a port from 0"),
    ],
)
def test_what_is_refused(words: list[str], text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*SCENE, *words]) == 2
    assert text in capsys.readouterr().err


HARDWARE = """
dimensions = 2
engine = "interpreted"
period = 0.002
duration = 1.0

[object]
mass = 0.1
viscosity = 0.8
shape = { kind = "sphere", radius = 0.02 }
position = [0.0, 0.057]
free = [false, false, false]

[coupling]
external.stiffness = 100.0
internal.stiffness = 70.0
absent = "follow"

[[finger]]
start = [0.0, 0.036]
device = { name = "haply-2diy", port = "/dev/no-such-board" }
"""


@pytest.mark.parametrize("command", ["stream", "view"])
def test_whoever_holds_hardware_is_told_before_it_is_opened(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("websockets")
    scene = tmp_path / "board.toml"
    scene.write_text(HARDWARE, "utf-8")
    assert main([command, str(scene), "--port", "0"]) != 0
    told = capsys.readouterr()
    assert "HARDWARE IS GOING TO BE ARMED" in told.out and "IS ARMED" not in told.out
    assert "/dev/no-such-board" in told.err
