"""The progress line: on a terminal after a second, gone before anything else is printed, silent everywhere else."""

from __future__ import annotations

import io
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import graspfx as gx
from graspfx.progress import Wait, clear, listening, waiting
from graspfx.show import progress_line
from graspfx.show.progress_line import ProgressLine, duration_text, quantity_text, text_of

LONG = ["paper-waving", "--no-figure", "--set", "engine='interpreted'", "--duration", "400"]  # 80 000 ticks


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Listener:
    """A listener that writes down what it hears."""

    def __init__(self) -> None:
        self.words: list[str] = []

    def begin(self, wait: Wait) -> None:
        self.words.append(f"begin {wait.text}")

    def end(self, wait: Wait) -> None:
        self.words.append(f"end {wait.text}")

    def clear(self) -> None:
        self.words.append("clear")


class Reader(Listener):
    """A listener that reads a wait when it ends, as the line's thread does before."""

    def end(self, wait: Wait) -> None:
        self.words.append(text_of(wait, wait.began + 2.0))


@pytest.mark.parametrize(("stiffness", "said"), [(70.0, ""), (1e6, ", zero force after a fault")])
def test_a_run_that_has_a_fault_says_so_before_it_ends(stiffness: float, said: str) -> None:
    reader = Reader()
    with listening(reader):
        rec = gx.run("reference-1dof", {"coupling.internal.stiffness": stiffness}, duration=1.0)
    assert bool(rec.faults) == bool(said)
    assert f"running reference-1dof{said}: 100 %, 100 ticks/s, 0 s left" in reader.words


def test_a_wait_is_announced_and_ended_whatever_happens() -> None:
    listener = Listener()

    def interrupted() -> None:
        with waiting("outer"), waiting("inner"):
            clear()
            raise KeyboardInterrupt

    with listening(listener), pytest.raises(KeyboardInterrupt):
        interrupted()
    assert listener.words == ["begin outer", "begin inner", "clear", "end inner", "end outer"]
    with waiting("alone") as wait:
        clear()
    assert wait.text == "alone" and len(listener.words) == 5


def test_share_rate_and_time_left() -> None:
    wait = Wait("running", 1000.0, "ticks", None)
    assert text_of(wait, wait.began + 3.2) == "running: 3 s"
    wait.done = 250.0
    assert text_of(wait, wait.began + 5.0) == "running: 25 %, 50 ticks/s, 15 s left"  # 250 in 5 s, 750 to go
    wait = Wait("running", 4e9, "ticks", lambda: 2e9)
    assert text_of(wait, wait.began + 600.0) == "running: 50 %, 3.33 M ticks/s, 10 min 00 s left"
    assert text_of(Wait("compiling", None, "", None), 0.0).startswith("compiling: ")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.4, "0 s"), (59.4, "59 s"), (59.6, "1 min 00 s"), (3599.0, "59 min 59 s"), (7260.0, "2 h 01 min")],
)
def test_times_are_written_as_one_says_them(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


def test_quantities_have_three_digits() -> None:
    assert [quantity_text(x) for x in (7.0, 1234.0, 2.5e6, 3e9)] == ["7", "1.23 k", "2.5 M", "3 G"]


def test_the_line_comes_after_its_time_and_goes_with_its_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress_line, "PATIENCE", 0.05)
    monkeypatch.setattr(progress_line, "PAUSE", 0.01)
    terminal = Terminal()
    with listening(ProgressLine(terminal)):
        with waiting("short"):
            pass
        assert terminal.getvalue() == ""
        with waiting("long", 10.0, "things") as wait:
            wait.done = 5.0
            limit = time.monotonic() + 10.0
            while "long: 50 %" not in terminal.getvalue() and time.monotonic() < limit:
                time.sleep(0.01)
    text = terminal.getvalue()
    assert "long: 50 %" in text and text.endswith("\r\x1b[K")
    assert "\n" not in text


def on_terminal(arguments: list[str], folder: Path, until: str = "", signals: int = 0) -> tuple[int, str, str]:
    """Run a command whose standard error is a terminal; give its exit code, its output and what the terminal saw."""
    primary, secondary = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "graspfx", *arguments], cwd=folder, stdout=subprocess.PIPE, stderr=secondary,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    os.close(secondary)
    seen, limit = b"", time.monotonic() + 120.0
    while time.monotonic() < limit:
        if select.select([primary], [], [], 0.1)[0]:
            try:
                piece = os.read(primary, 4096)
            except OSError:  # the last one who wrote has gone
                break
            if not piece:
                break
            seen += piece
        if until and signals and re.search(until.encode(), seen):
            process.send_signal(signal.SIGINT)
            signals -= 1
    os.close(primary)
    assert process.stdout is not None
    output = process.stdout.read().decode()
    process.stdout.close()
    return process.wait(60), output, seen.decode()


def test_a_long_run_shows_rate_and_time_left_and_an_interrupt_leaves_the_line_clean(tmp_path: Path) -> None:
    code, _, seen = on_terminal(["run", *LONG], tmp_path, r"running paper-waving: \d+ %", 1)
    assert code == 130
    assert re.search(r"running paper-waving: \d+ %, [\d.]+ k? ?ticks/s, .* left", seen)
    assert re.search(r"\r\x1b\[Kinterrupted after [\d.]+ of 400 s", seen)  # on a line of its own


def test_who_asks_for_quiet_or_for_json_or_reads_a_file_sees_no_line(tmp_path: Path) -> None:
    words = ["run", *LONG[:-1], "8", "--overwrite", "--out", "here"]
    for more in ("-q", "--json"):
        code, _, seen = on_terminal([*words, more], tmp_path)
        assert (code, seen) == (0, "")
    done = subprocess.run([sys.executable, "-m", "graspfx", *words], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
