"""Answers: keys of a terminal or of a page, and what a person has to do before hardware exerts a force."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspfx.errors import InputError
from graspfx.experiment.answering import QUIET, Answer, Keys, Press, Stopped
from graspfx.experiment.experiment import Experiment
from graspfx.experiment.session_files import SessionFiles
from graspfx.experiment.trial import Presentation, Trial
from graspfx.experiment.trial_table import read_table
from graspfx.live.frame import Frame
from graspfx.live.live_run import LiveRun
from graspfx.system.terminal import terminal_keys
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
            keys.ready("hold the device; its forces come when you press Enter")
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
        with pytest.raises(InputError, match="a function that waits until a person acts"):
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


def test_a_page_answers(tmp_path: Path) -> None:
    """Buttons of the page press the keys; a browser is not needed to see that."""
    pytest.importorskip("viser", reason="the page: pip install 'graspfx[view]'")
    from graspfx.experiment.answer_page import AnswerPage

    keys = Keys(lambda text: None, lambda: False)
    plain = experiment(PLAIN)
    assert plain.table.question is not None
    with AnswerPage("test", plain.table.question.keys, keys.press, plain.scene, port=0) as page:
        page.tell("How is it?")
        assert "How is it?" in page._text.content
        groups = {
            handle.options: handle for handle in page.server.viser.gui._gui_input_handle_from_uuid.values()
            if hasattr(handle, "options")
        }  # fmt: skip
        assert set(groups) == {("soft", "hard"), ("Ready",)}
        keys.listen(plain.table.question.keys)
        message: Callable[[str, str], dict[str, Any]] = lambda uuid, value: {  # noqa: E731
            "type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value},
        }  # fmt: skip
        uuid = groups["soft", "hard"]._impl.uuid
        assert page.server._accepts(message(uuid, "hard"))
        assert not page.server._accepts(message(uuid, "none of them"))
    assert SessionFiles(tmp_path, "1", "2", "a").stem == "sub-1_ses-2_task-a_run-01"


def test_a_page_draws_the_run_that_is_attached(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("viser", reason="the page: pip install 'graspfx[view]'")
    from graspfx.experiment.answer_page import AnswerPage

    plain, frames = experiment(PLAIN), list[Frame]()
    assert plain.scene is not None
    with AnswerPage("test", {}, lambda key: None, plain.scene, port=0) as page, LiveRun(plain.scene) as run:
        monkeypatch.setattr(page._tree, "show", frames.append)
        page.attach(run)
        run.await_row(0, 5.0)
        assert not frames  # nobody looks on
        monkeypatch.setattr(page.server.gate, "pages", 1)
        wait_until(lambda: len(frames) > 2)
        page.detach()
        drawn = len(frames)
        time.sleep(0.2)
        assert len(frames) == drawn
    assert frames[-1].time > frames[0].time
