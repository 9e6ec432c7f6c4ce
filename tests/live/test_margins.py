"""The process that certifies what sliders say: the newest request first, no request waits, nothing is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import graspfx as gx
from graspfx.live.certifier import Verdict
from graspfx.live.margins import NICENESS, Margins
from tests.support.hardware import driver
from tests.support.waiting import wait_until

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes of POSIX")

KEP, KIP = "coupling.external.stiffness", "coupling.internal.stiffness"
PATIENCE = 120.0  # [s], of a busy machine
PROGRAM = """
import sys, time
import graspfx as gx
from graspfx.live.margins import Margins

margins = Margins(gx.load("mug"))
if sys.argv[1] == "idle":
    assert margins.await_verdict(1, 120.0)
else:
    while margins._process is None:
        time.sleep(0.001)
print(margins._process.pid, flush=True)
while True:
    if sys.argv[1] == "busy":
        margins.ask({"coupling.external.stiffness": 200.0 + time.perf_counter() % 50.0})
    time.sleep(0.01)
"""


@pytest.fixture(scope="module")
def asked() -> Iterator[tuple[Margins, list[Verdict]]]:
    verdicts: list[Verdict] = []
    with Margins(gx.load("sphere-three-fingers"), verdicts.append) as margins:
        yield margins, verdicts


def pid_of(margins: Margins) -> int:
    assert margins._process is not None
    return margins._process.pid


def is_alive(pid: int) -> bool:
    try:
        return (Path("/proc") / str(pid) / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_an_answer_is_provisional_first(asked: tuple[Margins, list[Verdict]]) -> None:
    margins, verdicts = asked
    first = margins.await_verdict(1, PATIENCE)
    assert first is not None
    assert first.is_stable
    assert first.values == {}
    assert first.text.startswith("stable: external")
    for values in ({KEP: 900.0}, {KEP: 150.0}):  # red at once, and stable again provisionally before it is so in full
        verdicts.clear()
        number = margins.ask(values)
        last = margins.await_verdict(number, PATIENCE)
        assert [(each.stage, each.is_provisional) for each in verdicts] == [(0, True), (1, True), (2, False)]
        assert last is margins.latest() is verdicts[-1]
        assert all(each.values == values for each in verdicts)
        assert {each.is_stable for each in verdicts} == {values[KEP] < 600.0}
        assert ("(provisional)" in verdicts[0].text) and "(provisional)" not in verdicts[2].text


def test_the_newest_request_wins(asked: tuple[Margins, list[Verdict]]) -> None:
    """A slider that is dragged: each verdict is newer than the one before it, and the last is in full."""
    margins, verdicts = asked
    assert margins.await_verdict(1, PATIENCE)
    verdicts.clear()
    requests, longest, end = 0, 0.0, time.perf_counter() + PATIENCE
    while requests < 300 or sum(each.stage == 0 for each in verdicts) <= 10:  # some are answered while it is dragged
        assert time.perf_counter() < end
        began = time.perf_counter()
        stiffness = 100.0 + requests % 300
        number = margins.ask({KEP: stiffness, KIP: 400.0})
        longest = max(longest, time.perf_counter() - began)
        requests += 1
        time.sleep(0.001)
    last = margins.await_verdict(number, PATIENCE)
    assert last is not None
    assert last.values == {KEP: stiffness, KIP: 400.0}
    order = [(each.number, each.stage) for each in verdicts]
    assert order == sorted(set(order))
    assert sum(not each.is_provisional for each in verdicts) < requests / 2  # the others were dropped
    assert longest < PATIENCE / 100  # nothing waits for a certificate


def test_an_error_is_a_text_and_the_next_request_is_answered(asked: tuple[Margins, list[Verdict]]) -> None:
    margins, _ = asked
    bad = margins.await_verdict(margins.ask({KIP: -5.0}), PATIENCE)
    assert bad is not None
    assert bad.is_stable is None
    assert "expected no less than 0; given -5.0" in bad.error
    unsent = margins.await_verdict(margins.ask({KIP: lambda: 0.0}), PATIENCE)
    assert unsent is not None
    assert "values cannot be pickled" in unsent.error
    good = margins.await_verdict(margins.ask({KIP: 300.0}), PATIENCE)
    assert good is not None
    assert good.is_stable


def test_it_takes_no_time_from_others(asked: tuple[Margins, list[Verdict]]) -> None:
    margins, _ = asked
    assert margins.await_verdict(1, PATIENCE)
    pid = pid_of(margins)
    assert os.getpriority(os.PRIO_PROCESS, pid) == min(os.getpriority(os.PRIO_PROCESS, 0) + NICENESS, 19)
    assert b"OPENBLAS_NUM_THREADS=1" in (Path("/proc") / str(pid) / "environ").read_bytes().split(b"\0")
    assert os.getpgid(pid) == pid  # Ctrl-C is for whoever began it


@pytest.mark.parametrize("work", ["starting", "idle", "busy"])
def test_it_dies_with_its_parent(work: str) -> None:
    """The parent is killed: it can say nothing any more."""
    parent = subprocess.Popen([sys.executable, "-c", PROGRAM, work], stdout=subprocess.PIPE)
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    assert is_alive(pid)
    if work == "busy":
        time.sleep(0.3)
    parent.kill()
    parent.wait()
    wait_until(lambda: not is_alive(pid), 5.0)
    parent.stdout.close()


def test_its_death_is_told(asked: tuple[Margins, list[Verdict]]) -> None:
    with Margins(gx.load("reference-1dof")) as margins:
        assert margins.await_verdict(1, PATIENCE)
        pid = pid_of(margins)
        os.kill(pid, signal.SIGKILL)
        wait_until(lambda: bool((verdict := margins.latest()) and verdict.error))
        verdict = margins.await_verdict(margins.ask({KEP: 20.0}), 0.1)
        assert verdict is not None
        assert verdict.text == "not judged: the process that computes certificates has ended"
    assert not is_alive(pid)


def test_it_can_be_closed_at_any_time() -> None:
    """While it starts, and while it does not answer at all."""
    scene = gx.load("reference-1dof")
    Margins(scene).close()
    margins = Margins(scene)
    assert margins.await_verdict(1, PATIENCE)
    pid = pid_of(margins)
    os.kill(pid, signal.SIGSTOP)
    for k in range(3000):  # more than a pipe takes
        margins.ask({KEP: 20.0 + k, "a long key" * 20: 1.0})
    margins.close()
    assert not is_alive(pid)
    assert margins.await_verdict(margins.ask({KEP: 1.0}), 10.0) is None


def test_a_scene_that_is_no_data_has_an_error(tmp_path: Path) -> None:
    finger = {
        "start": [-0.02], "device": {"name": str(driver(tmp_path)), "position": [[-0.02]], "board": lambda: 0},
    }  # fmt: skip
    line = gx.load("reference-1dof").to_dict()
    with Margins(gx.Scene(**line | {"finger": [finger, line["finger"][1]]})) as margins:
        verdict = margins.await_verdict(1, PATIENCE)
    assert verdict is not None
    assert verdict.is_stable is None
    assert "finger.0.device.board" in verdict.error
