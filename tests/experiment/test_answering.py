"""Answers: keys of a terminal or of a page, and what a person has to do before hardware exerts a force."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspfx.errors import InputError
from graspfx.experiment.answering import QUIET, Answer, Keys, Press, Stopped
from graspfx.experiment.design import Experiment
from graspfx.experiment.trial import Presentation, Trial
from graspfx.experiment.trial_table import read_table
from graspfx.live.live_run import LiveRun
from graspfx.system.terminal import terminal_keys
from tests.support.chromium import Browser
from tests.support.experiments import PLAIN, experiment, table_of
from tests.support.servo_wires import BUSY, PATIENT, PRESSED, board, boards_scene
from tests.support.waiting import wait_until

SHOWN = Presentation(Trial(1, "low", 1, {}, [{}]), [])


def test_an_answer_is_a_key_that_was_pressed_after_the_question() -> None:
    keys = Keys(lambda text: None, lambda: False)
    for key in ("s", "\n"):
        keys.press(key)
    keys.listen({"s": "soft", "h": "hard"})
    assert not keys.has_answered()
    keys.press("x")
    keys.presses.put(Press("h", 12.5))
    keys.press("s")
    assert keys.has_answered()
    assert keys.answer(SHOWN) == Answer("hard", 12.5)


def test_a_person_is_ready_after_being_asked() -> None:
    texts: list[str] = []
    keys = Keys(texts.append, lambda: False)
    keys.press("\n")  # before it was asked: it arms nothing
    ready = threading.Event()

    def wait() -> None:
        keys.ready("press Enter")
        ready.set()

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    wait_until(lambda: bool(texts))
    keys.press("s")
    clock = time.monotonic()
    for k in range(3):  # Enter is held down: it repeats itself
        keys.presses.put(Press("\n", clock + 0.03 * k))
    assert not ready.wait(0.15)
    keys.presses.put(Press("\n", clock + 0.1 + QUIET))
    assert ready.wait(60.0)
    thread.join()


def test_the_end_of_input_ends_the_session() -> None:
    keys = Keys(lambda text: None, lambda: False)
    keys.listen({"s": "soft"})
    keys.end()
    with pytest.raises(Stopped):
        keys.answer(SHOWN)
    with pytest.raises(Stopped):
        Keys(lambda text: None, lambda: True).ready("press Enter")


@contextmanager
def standing_in(file: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with os.fdopen(file, "r", closefd=False) as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        yield


@pytest.mark.skipif(sys.platform == "win32", reason="terminals of POSIX")
def test_keys_of_a_terminal_come_at_once_and_are_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    import pty
    import termios

    outer, inner = pty.openpty()
    before = termios.tcgetattr(inner)
    keys: list[tuple[str, float]] = []
    with standing_in(inner, monkeypatch), terminal_keys(lambda key: keys.append((key, time.monotonic())), _never):
        assert not termios.tcgetattr(inner)[3] & termios.ECHO
        pressed = time.monotonic()
        os.write(outer, b"s")
        wait_until(lambda: bool(keys))
        assert keys[0][0] == "s" and keys[0][1] >= pressed
        os.write(outer, b"h\n")
        wait_until(lambda: len(keys) == 3)
    assert [key for key, _ in keys] == ["s", "h", "\n"]
    assert termios.tcgetattr(inner) == before
    os.close(outer)
    os.close(inner)


@pytest.mark.skipif(sys.platform == "win32", reason="terminals of POSIX")
def test_a_terminal_that_is_closed_ends_the_wait_and_arms_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    import pty

    outer, inner = pty.openpty()
    keys = Keys(lambda text: None, lambda: False)
    read, reads = os.read, []

    def count(file: int, most: int) -> bytes:
        reads.append(file)
        return read(file, most)

    monkeypatch.setattr(os, "read", count)
    with standing_in(inner, monkeypatch), terminal_keys(keys.press, keys.end):
        closing = threading.Timer(0.05, os.close, [outer])
        closing.start()
        with pytest.raises(Stopped, match="the input of answers has ended"):
            keys.ready("hold the device; it exerts forces after you press Enter")
        closing.join()
        wait_until(lambda: not any(thread.name == "keys" for thread in threading.enumerate()))
    assert reads.count(inner) == 1
    os.close(inner)


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
def test_lines_from_elsewhere_are_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    reader, writer = os.pipe()
    keys: list[str] = []
    ended = threading.Event()
    with standing_in(reader, monkeypatch), terminal_keys(keys.append, ended.set):
        os.write(writer, b"soft\n\nha")
        wait_until(lambda: len(keys) == 2)
        os.write(writer, b"rd\n")
        os.close(writer)
        assert ended.wait(60.0)
    os.close(reader)
    assert keys == ["s", "\n", "h"]


def _never() -> None:
    raise AssertionError


def boards_experiment(wire: Any, first: str = "40.0") -> Experiment:
    """Put two conditions before a board on an emulated wire."""
    plain = experiment(
        PLAIN, ("duration = 0.05", "duration = 1.0"), ("repetitions = 2", "repetitions = 1"),
        ('order = "random"', 'order = "fixed"'), ('stiffness" = 40.0', f'stiffness" = {first}'),
    )  # fmt: skip
    scene = boards_scene([wire], PATIENT, **BUSY, **{"finger.*.device.measures": {"mass": 0.1, "friction": 1.5}})
    return Experiment(plain.table, scene.replace({"engine": "interpreted"}), plain.source)


def test_hardware_is_armed_by_a_person_alone_and_faded_between_trials(tmp_path: Path) -> None:
    """No torque is there until a person acts, before each trial again; the run of a trial ends at zero."""
    with board() as wire:
        trials = boards_experiment(wire)
        with pytest.raises(InputError, match="a function that returns when a person is ready"):
            trials.run(tmp_path / "none", lambda shown: "soft", real_time=True)
        asked: list[str] = []

        def ready(text: str) -> None:
            asked.append(text)
            assert not np.any(wire.torque)
            wire.place(np.array(PRESSED))

        def respond(shown: Presentation) -> str:
            assert not np.any(wire.torque)  # forces have faded before the question
            return "soft"

        def session(resume: bool) -> bool:
            """Go on, and tell whether it went to its end: a busy machine may be too late for a board, a fault."""
            try:
                trials.run(tmp_path / "study", respond, real_time=True, ready=ready, resume=resume)
            except InputError as error:
                return "which ended in a fault" not in str(error)
            return True

        assert session(False) or any(session(True) for _ in range(4))
        assert all("hold the device" in text for text in asked) and len(asked) >= 2
        assert not np.any(wire.torque)
    table = read_table(table_of(tmp_path / "study"))
    assert [row["condition"] for row in table] == ["low", "high"]
    assert len(asked) == len(table)


def test_a_stimulus_that_is_not_certified_arms_nothing(tmp_path: Path) -> None:
    asked: list[str] = []
    with board() as wire:
        trials = boards_experiment(wire, "5000.0")
        with pytest.raises(InputError, match="stimulus"):
            trials.run(tmp_path, lambda shown: "soft", real_time=True, ready=asked.append)
        assert not asked and not np.any(wire.torque)
    assert not list(tmp_path.rglob("*.tsv"))


PAGE = "the page: pip install 'graspfx[view]'"


def test_a_page_answers() -> None:
    """Its messages press the keys of the question, and no others; a browser is not needed to see that."""
    pytest.importorskip("websockets", reason=PAGE)
    from graspfx.experiment.answer_page import AnswerPage
    from graspfx.live.view.page_server import Order

    keys = Keys(lambda text: None, lambda: False)
    plain = experiment(PLAIN)
    assert plain.table.question is not None
    with AnswerPage("test", plain.table.question.keys, keys.press, plain.scene, port=0) as page:
        keys.listen(plain.table.question.keys)
        for refused in (Order("answer", key="none of them"), Order("pause"), Order("set", 0, value=1.0)):
            assert not page.order(refused)
        assert not keys.has_answered()
        assert page.order(Order("answer", key="h"))
        assert keys.answer(SHOWN).response == "hard"


@pytest.mark.alone
def test_a_person_answers_on_a_page_that_shows_the_run(browser: Browser) -> None:
    """The question comes first, then the picture of each run that is attached; nothing else is shown of it."""
    pytest.importorskip("websockets", reason=PAGE)
    from graspfx.experiment.answer_page import AnswerPage

    plain, keys = experiment(PLAIN), list[str]()
    assert plain.table.question is not None
    with AnswerPage("test <b>", plain.table.question.keys, keys.append, plain.scene, port=0) as page:
        shown = browser.open(page.server.url, 800, 700)
        page.tell("How <i>is</i> it?")
        shown.wait_for("document.getElementById('question').textContent === 'How <i>is</i> it?'")
        assert shown.evaluate("[...document.querySelectorAll('#answers button')].map((each) => each.textContent)") == [
            *plain.table.question.keys.values(), "Ready"
        ]  # fmt: skip
        press = "[...document.querySelectorAll('#answers button')].find((each) => each.textContent === '{}').click()"
        shown.evaluate(press.format("Ready"))
        wait_until(lambda: keys == ["\n"])
        assert "Values" not in shown.evaluate("document.body.innerText")
        for _ in range(2):
            with LiveRun(plain.scene.replace({"duration": 60.0})) as run:
                page.attach(run)
                shown.wait_for("window.graspfx && graspfx.frames > 5 && seen !== null")
                before = shown.evaluate("graspfx.time")
                shown.wait_for(f"graspfx.time > {before}")
                page.detach()
            frames = shown.wait_for("graspfx.frames")
            time.sleep(0.2)
            assert shown.evaluate("graspfx.frames") >= frames
        text = shown.evaluate("document.body.innerText")
        assert "How <i>is</i> it?" in text and "Values" not in text and "Restart" not in text and "squeeze" not in text
        shown.evaluate(press.format("hard"))
        wait_until(lambda: keys == ["\n", "h"])
        assert shown.console_errors == []
