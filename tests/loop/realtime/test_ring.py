"""Rows, notes and letters between two processes: none is half there, and what is lost is counted."""

from __future__ import annotations

import copyreg
import os
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

import graspfx as gx
from graspfx.assembly.build import make_layout
from graspfx.assembly.process import guard as relays
from graspfx.assembly.process.guard import Relay
from graspfx.assembly.resolve import resolve
from graspfx.errors import DeviceError, InputError, RecordingError, SceneError, UnknownNameError
from graspfx.loop.columns import Layout
from graspfx.loop.realtime.pacing import Lateness
from graspfx.loop.realtime.ring import (
    NOTES,
    SLOTS,
    Letter,
    Ring,
    RingRecorder,
    Word,
    create,
    pack_error,
    read_letter,
    unpack_error,
    write_letter,
)
from graspfx.recording.header import Header
from graspfx.recording.recorder import Recorder


@pytest.fixture
def layout() -> Layout:
    return make_layout(resolve(gx.load("reference-1dof")))


@pytest.fixture
def pair(layout: Layout, request: pytest.FixtureRequest) -> Iterator[tuple[Ring, Ring]]:
    """Give one memory seen twice, as from two processes."""
    every = getattr(request, "param", 1)
    file = create(layout.width)
    yield Ring(file, layout.width, every), Ring(file, layout.width, every)
    os.close(file)


def tick(recorder: RingRecorder, every: int, count: int = 1) -> None:
    """Let ticks write their numbers into their rows."""
    for _ in range(count):
        rows, place, left = recorder.space()
        assert left > 0
        if place % every == 0:
            rows[place // every] = recorder.ticks
        recorder.take(1)


@pytest.mark.parametrize("pair", [1, 3], indirect=True)
def test_rows_arrive_whole_and_in_order(pair: tuple[Ring, Ring], layout: Layout) -> None:
    """Over the end of the ring, for uneven looks, blocks of any size and rows of every third tick alone."""
    ours, theirs = pair
    every = ours.every
    servo = RingRecorder(theirs)
    recorder = Recorder(layout, Header(0.001, every=every), block=1000)
    batches: list[tuple[int, int]] = []
    relay = Relay(ours, recorder, lambda first, count: batches.append((first, count)))
    while servo.ticks < 2.5 * SLOTS * every:
        tick(servo, every, 1 + 7919 * (servo.ticks % 13) // 13)
        relay.fetch()
    rec = recorder.finish()
    assert relay.lost == 0
    assert np.array_equal(rec.rows[:, 0], np.arange(0, servo.ticks, every))
    assert (rec.rows == rec.rows[:, :1]).all()
    assert batches[0][0] == 0
    assert all(a + b == c for (a, b), (c, _) in pairwise(batches))
    assert int(theirs.words[Word.TAIL]) == servo.ticks


@pytest.mark.parametrize("pair", [1, 4], indirect=True)
def test_rows_that_are_not_fetched_in_time_are_missing_and_counted(pair: tuple[Ring, Ring], layout: Layout) -> None:
    """The ring has the last ones; the row that may be written at the moment is none of them."""
    ours, theirs = pair
    every = ours.every
    servo, recorder = RingRecorder(theirs), Recorder(layout, Header(0.001, every=every), block=500)
    relay = Relay(ours, recorder)
    tick(servo, every, 10 * every)
    relay.fetch()
    tick(servo, every, (SLOTS + 100) * every)
    relay.fetch()
    rec = recorder.finish()
    missing = np.isnan(rec.rows[:, 0])
    assert relay.lost == missing.sum() == 101
    assert len(rec.rows) == SLOTS + 110
    assert np.flatnonzero(missing).tolist() == list(range(10, 111))
    assert np.array_equal(rec.rows[~missing, 0], np.arange(0, servo.ticks, every)[~missing])


def test_a_disk_that_is_behind_leaves_rows_in_the_ring(
    pair: tuple[Ring, Ring], layout: Layout, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Memory has a bound: what is beyond it waits, and is fetched when there is room again."""
    ours, theirs = pair
    servo, recorder = RingRecorder(theirs), Recorder(layout, Header(0.001))
    relay = Relay(ours, recorder)
    monkeypatch.setattr(relays, "BACKLOG", -1)
    tick(servo, 1, 50)
    relay.fetch()
    assert relay.ticks == 0
    monkeypatch.setattr(relays, "BACKLOG", 0)
    relay.fetch()
    assert (relay.ticks, relay.lost) == (50, 0)


def test_notes_are_there_however_a_process_ends(pair: tuple[Ring, Ring], layout: Layout) -> None:
    ours, theirs = pair
    servo, recorder = RingRecorder(theirs), Recorder(layout, Header(0.001))
    relay = Relay(ours, recorder)
    relay.letters[1] = {"coupling.friction": 0.5}
    servo.fault(3, "no new sample")
    servo.change(4, {"letter": 1})
    servo.change(5, {"rest": "stop"})
    relay.fetch()
    servo.fault(6, "x" * NOTES)  # which has no room
    servo.fault(7, "gone")
    relay.fetch()
    rec = recorder.finish()
    assert [tuple(fault) for fault in rec.faults] == [(3, "no new sample"), (7, "gone")]
    assert [tuple(change) for change in rec.outcome.changes] == [(4, "coupling.friction", 0.5), (5, "rest", "stop")]


def test_notes_go_round(pair: tuple[Ring, Ring], layout: Layout) -> None:
    """A slider that is dragged for an hour leaves more notes than there is room for at once; none is lost."""
    ours, theirs = pair
    servo, recorder, rng = RingRecorder(theirs), Recorder(layout, Header(0.001)), np.random.default_rng(0)
    relay, count = Relay(ours, recorder), 0
    while theirs.words[Word.NOTES] < 3.3 * NOTES:
        for _ in range(int(rng.integers(1, 60))):
            servo.change(count, {"rest": "x" * int(rng.integers(0, 300))})
            count += 1
        relay.fetch()
    assert [change.tick for change in recorder.changes] == list(range(count))


def test_goals_are_told_once_each_in_order(layout: Layout) -> None:
    """Also over the end of their log; who comes too late has the last ones."""
    file = create(layout.width, 3)
    ours, theirs = Ring(file, layout.width, 1, 3), Ring(file, layout.width, 1, 3)
    os.close(file)
    recorder = Recorder(layout, Header(0.001))
    relay = Relay(ours, recorder, goals=lambda goals: {"goal": goals.tolist()})
    for first in range(0, 3 * SLOTS, SLOTS // 2):
        for k in range(first, first + SLOTS // 2):
            theirs.goal_log[k % SLOTS] = k, k, 2 * k, -k
        theirs.words[Word.GOALS] = first + SLOTS // 2
        relay.fetch()
    assert [change.tick for change in recorder.changes] == list(range(3 * SLOTS))
    assert recorder.changes[-1].value == [3 * SLOTS - 1, 6 * SLOTS - 2, 1 - 3 * SLOTS]
    ours.goals[1] = 7.0
    assert theirs.goals.tolist() == [[0.0] * 3, [7.0] * 3]
    theirs.words[Word.GOALS] += 2 * SLOTS
    relay.fetch()
    assert len(recorder.changes) == 4 * SLOTS - 1


def test_a_letter_is_read_as_it_was_written() -> None:
    place = memoryview(bytearray(1 << 12))
    entries = [
        (2, np.array([5, 1, 7], np.intp), np.array([0.1, -0.0, np.inf])),
        (0, np.zeros(0, np.intp), np.zeros(0)),
        (1, np.array([3], np.intp), np.array([2.5])),
    ]
    write_letter(Letter(entries, [1, 0], [2]), place)
    letter = read_letter(place)
    assert (letter.objects, letter.plants) == ([1, 0], [2])
    for (memory, places, numbers), (m, p, n) in zip(entries, letter.entries, strict=True):
        assert (memory, places.tolist(), numbers.tobytes()) == (m, p.tolist(), n.tobytes())
    with pytest.raises(InputError, match="values of at most"):
        write_letter(Letter([(0, np.zeros(999, np.intp), np.zeros(999))], []), place)


def test_lateness_is_counted_in_bins() -> None:
    late = Lateness()
    assert late.figures == {}
    for value in (*([10e-6] * 98), 2e-3, 1.0):
        late.add(value)
    figures = late.figures
    assert figures["p50"] == pytest.approx(11e-6)
    assert figures["p99"] == pytest.approx(2.001e-3)
    assert figures["p99.9"] == figures["max"] == 1.0


@pytest.mark.parametrize(
    "error",
    [
        DeviceError("the cable is out"),
        InputError("coupling.enter", "refuse", "fingers outside", "move it out"),
        UnknownNameError("device", "haply", ["haply-2diy"]),
        SceneError("scene", []),
        RecordingError("full"),
        OSError(5, "Input/output error"),
        SystemExit(7),
        KeyboardInterrupt(),
        KeyError("axis"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_travel_whole(error: BaseException) -> None:
    again = unpack_error(pack_error(error))
    assert type(again) is type(error)
    assert (str(again), again.args) == (str(error), error.args)
    for name in ("name", "given", "expected", "do", "kind", "known", "source", "faults", "code", "errno"):
        assert getattr(again, name, None) == getattr(error, name, None)


def test_errors_travel_in_their_own_way_whatever_way_others_register(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(copyreg.dispatch_table, SystemExit, lambda error: (SystemExit.__new__, (SystemExit, 7)))
    again = unpack_error(pack_error(SystemExit(7)))
    assert isinstance(again, SystemExit) and again.code == 7


def test_errors_that_cannot_travel_leave_their_words() -> None:
    class Local(Exception):
        """An error of a function's."""

    assert str(unpack_error(pack_error(Local("no way")))) == "Local: no way"
    odd = DeviceError("with a device")
    odd.device = lambda: 0  # type: ignore[attr-defined]
    again = unpack_error(pack_error(odd))
    assert (type(again), str(again)) == (DeviceError, "with a device")
