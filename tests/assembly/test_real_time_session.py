"""A session in real time: it goes on by itself, takes new gains between two ticks, and is the run that it would be."""

from __future__ import annotations

import os
import signal
import threading
import time
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError
from graspfx.loop.realtime.ring import Word
from tests.support.servo_wires import BUSY, PATIENT, PRESSED, board, boards_scene, servo_of, settled
from tests.support.waiting import wait_until

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="processes of POSIX")

LINE = "reference-1dof"
STIFFNESS, FRICTION = "coupling.internal.stiffness", "coupling.external.damping"


def test_a_steered_session_is_the_run_that_is_steered_at_the_same_ticks(tmp_path: Path) -> None:
    """Bits are the same by the wall's clock in another process, and step by step in this one."""
    with gx.open(LINE, real_time=True, live=[STIFFNESS, FRICTION], out=tmp_path) as session:
        assert session.wait(0.1)
        session.set(STIFFNESS, 90.0)
        session.wait(0.05)
        session.set({STIFFNESS: 40.0, FRICTION: 0.1})
        assert session.mark("trial 1") > 0
        assert session.wait(0.1)
        assert session.values == {STIFFNESS: 40.0, FRICTION: 0.1}
        assert 0 < len(session.recording) <= session.tick + 100
        wait_until(lambda: session.force.any())
        with pytest.raises(InputError, match="use wait instead of step"):
            session.step()
    rec = session.recording
    assert rec.outcome.complete
    assert rec.header.scheduling["loop"] == "process"
    ticks = [change.tick for change in rec.changes]
    assert [change.key for change in rec.changes] == [STIFFNESS, STIFFNESS, FRICTION]
    assert ticks[1] == ticks[2] > ticks[0] > 0
    assert [event.text for event in rec.events if event.kind == "mark"] == ["trial 1"]
    with gx.open(LINE, live=[STIFFNESS, FRICTION]) as own:
        own.step(ticks[0])
        own.set(STIFFNESS, 90.0)
        own.step(ticks[1] - ticks[0])
        own.set({STIFFNESS: 40.0, FRICTION: 0.1})
        own.step(len(rec) - ticks[1])
    for name in ("finger_position", "finger_force", "internal_force", "external_force", "touching"):
        assert np.array_equal(getattr(rec, name), getattr(own.recording, name)), name


def test_a_session_with_hardware_rests_at_its_end_and_after_a_signal() -> None:
    """Handles are pressed; `rest` and Ctrl-C take the force away, and a servo that is killed is told."""
    with board() as wire:
        scene = boards_scene([wire], PATIENT, **BUSY)

        def press() -> None:
            wire.place(np.array(PRESSED))
            wait_until(lambda: bool(np.abs(wire.torque).max() > 1e-3))

        with settled(lambda: gx.open(scene, real_time=True, live=[STIFFNESS])) as session:
            press()
            session.set(STIFFNESS, 100.0)
            session.rest()
            wait_until(lambda: not wire.torque.any())  # the line has its own delay
            assert not session.wait(0.01)
            with pytest.raises(InputError, match="a session that is running; this session has ended"):
                session.set(STIFFNESS, 50.0)
        assert session.recording.displayed_force.any()
        assert not session.recording.faults
        wire.home()
        sessions: list[gx.RealTimeSession] = []

        def sleep_in_a_session() -> None:
            with settled(lambda: gx.open(scene, real_time=True)) as session:
                sessions.append(session)
                press()
                threading.Timer(0.1, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
                time.sleep(600.0)

        with pytest.raises(KeyboardInterrupt):
            sleep_in_a_session()
        wait_until(lambda: not wire.torque.any())  # the line has its own delay
        assert sessions[0].recording.outcome.cause == "SIGINT"
        wire.home()
        with settled(lambda: gx.open(scene, real_time=True)) as session:
            press()
            os.kill(servo_of(os.getpid()), signal.SIGKILL)
            assert not session.wait(10.0)
            wait_until(lambda: not wire.torque.any())  # the line has its own delay
        assert session.fault is not None
        assert not session.recording.outcome.complete
        assert session.recording.outcome.cause == "the servo's process was ended by SIGKILL"
        wire.home()
        inside = boards_scene([wire], PATIENT, **{"object.0.position": [0.0, 0.05]})
        with pytest.raises(InputError, match=r"finger0 is .* mm inside ball0"):
            settled(lambda: gx.open(inside, real_time=True))


def test_hands_and_devices_of_simulations_take_new_numbers_in_real_time() -> None:
    """Arm, grip, turn and masses of a hand that holds three points, and goals of its guide: the stepped run's bits."""
    hand, mass, goal = "hand.0.grip.stiffness", "finger.*.device.mass", "hand.0.guide.offset"
    scene = gx.load("sphere-three-fingers", {"hand.0.guide": {}})
    changes: list[dict[str, Any]] = [
        {hand: 260.0, goal: [0.0, 0.0, 0.004]},
        {mass: 0.14, "hand.0.turn.angle": 0.6, STIFFNESS: 350.0},
        {goal: [0.002, 0.0, 0.0], hand: 310.0},
    ]
    keys = [hand, mass, "hand.0.turn", goal, STIFFNESS]
    with gx.open(scene, live=keys, real_time=True) as session:
        for change in changes:
            session.wait(0.1)
            session.set(change)
        session.wait(0.2)
    rec = session.recording
    assert {change.key for change in rec.changes} == {*keys, "hand.0.turn.angle"} - {"hand.0.turn"}
    with gx.open(scene, live=keys) as own:
        for tick, each in groupby(sorted(rec.changes, key=lambda change: change.tick), lambda change: change.tick):
            if tick > own.tick:
                own.step(tick - own.tick)
            own.set({change.key: change.value for change in each})
        own.step(len(rec) - own.tick)
    for other in (own.recording, gx.replay(rec)):
        for name in ("finger_position", "finger_force", "object_position", "touching"):
            assert np.array_equal(getattr(rec, name), getattr(other, name)), name


def test_what_is_more_than_numbers_is_not_live_in_real_time() -> None:
    with board() as wire:
        table = boards_scene([wire], PATIENT).to_dict()
        simulated = {"device": {"name": "simulated", "mass": 0.1}, "hand": {"stiffness": 50.0}}
        table["finger"].append({"start": [0.0, 0.2], "object": "ball0", **simulated})
        with pytest.raises(InputError, match="keys of hands and devices cannot be live"):
            gx.open(gx.Scene(**table), real_time=True, live=["finger.1.hand.stiffness"])
    with pytest.raises(InputError, match="only the mechanics of a simulated point"):
        gx.open("paper-waving", real_time=True, live=["finger.0.device.mass"])
    with pytest.raises(InputError, match="True for the wall clock"):
        gx.open(LINE, real_time=1)  # type: ignore[call-overload]


def test_simulations_bear_a_program_that_is_busy() -> None:
    """It fetches no row for twice as long as a hand on hardware would wait; no tick is held up by that."""
    with gx.open(LINE, real_time=True) as session:
        assert session.wait(0.1)
        words, count = session._remote.ring.words, round(1.0 / session.scene.period)
        with session._remote.guard.lock:
            last = int(words[Word.HEAD]) + count
            wait_until(lambda: int(words[Word.HEAD]) >= last)
        assert session.wait(0.1)
    assert session.recording.outcome.complete
    assert session.recording.outcome.lost == 0
    assert len(session.recording) >= last
