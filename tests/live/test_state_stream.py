"""Streams of a running scene: states are the rows of the ring, goals come to its hands, and LSL has what was sent."""

from __future__ import annotations

import json
import re
import signal
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspfx as gx
from graspfx.errors import InputError, MissingPackageError
from graspfx.experiment.session_of_trials import Event, LslMarkers
from graspfx.live.live_run import LiveRun
from graspfx.live.lsl_outlet import RowStream, load_lsl
from graspfx.live.state_stream import stream_of
from tests.support.rooms import ROOT
from tests.support.waiting import wait_until

pytest.importorskip("websockets", reason="the stream's socket: pip install 'graspfx[touch]'")
from websockets.sync.client import connect as open_socket
from websockets.sync.connection import Connection

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="processes of POSIX")


def states(client: Connection, count: int) -> list[dict[str, Any]]:
    """Read that many states."""
    messages: list[dict[str, Any]] = []
    while len(messages) < count:
        message = json.loads(client.recv(10.0))
        if message["type"] == "state":
            messages.append(message)
    return messages


def test_states_are_rows_and_goals_lead_hands(tmp_path: Path) -> None:
    """Each number is that of the recording's row at its tick; a goal is recorded, and stays."""
    scene = gx.load("paper-waving", {"engine": "interpreted"})
    with ExitStack() as stack:
        stream, address = stream_of(stack, goals=True, port=0)
        run = stack.enter_context(LiveRun(scene, out=tmp_path, guide="fingers"))
        stream.attach(run)
        with open_socket(address, proxy=None, compression=None) as client:
            hello = json.loads(client.recv(10.0))
            assert hello["protocol"] == "graspfx-stream/1" and hello["units"]["force"] == "N"
            assert [guide["name"] for guide in hello["guides"]] == ["thumb", "forefinger"]
            seen = states(client, 3)
            client.send('{"type":"goal","number":1,"guide":0,"offset":[0.0,0.012,0.0]}')
            wait_until(lambda: run.goal(0)[0].tolist() == [0.0, 0.012])
            seen += states(client, 5)
            client.send('{"type":"goal","number":2,"guide":0,"offset":[0.5,0.0,0.0]}')  # too far
            wait_until(lambda: stream.server.counts["place"] == 1)
            assert states(client, 3)[-1]["you"]["dropped"] == 1
        wait_until(lambda: stream.server.clients == 0)
        time.sleep(0.1)
        assert run.goal(0)[0].tolist() == [0.0, 0.012]  # it stays where it has come
        stream.detach()
    recording = gx.Recording.load(tmp_path)
    for state in seen:
        k = state["tick"]
        assert state["time"] == recording.time[k] and state["run"] == 1 and state["state"] == "running"
        for i, finger in enumerate(state["fingers"]):
            assert finger["force"] == [*(recording.finger_force[k, i] * recording.touching[k, i]).tolist(), 0.0]
            assert finger["position"] == [*recording.true_position[k, i].tolist(), 0.0]  # type: ignore[index]
            total = np.array(finger["internal"]) + np.array(finger["external"])
            assert np.allclose(total, finger["force"], atol=1e-15)
        assert state["objects"][0]["position"] == [*recording.object_position[k].tolist(), 0.0]
    offsets = [np.array(change.value)[0] for change in recording.changes if change.key.endswith("guide.offset")]
    assert offsets[-1].tolist() == [0.0, 0.012]


def test_the_client_of_the_page_is_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The Python of docs/how-to/stream.md runs as it stands."""
    page = (ROOT / "docs" / "how-to" / "stream.md").read_text("utf-8")
    (code,) = re.findall(r"```python\n(import json\n.*?)```", page, re.DOTALL)
    assert len(code.splitlines()) <= 15
    scene = gx.load("paper-waving", {"engine": "interpreted"})
    with ExitStack() as stack:
        stream, address = stream_of(stack, goals=True, port=0)
        run = stack.enter_context(LiveRun(scene, guide="fingers"))
        stream.attach(run)
        exec(compile(code.replace("ADDRESS", repr(address)), "stream.md", "exec"), {})
        assert np.abs(run.goal(0)[0]).max() > 0.0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 5 and lines[0].startswith("Waving a cube")


@pytest.mark.parametrize(
    ("mirror", "mirrored"),
    [([[1, 0, 0], [0, 1, 0], [0, 0, -1]], (-1, -2, 3, 4)), ([[1, 0, 0], [0, 0, 1], [0, 1, 0]], (-1, -3, -2, 4))],
)
def test_the_page_turns_rotations_for_a_left_handed_program(mirror: Any, mirrored: tuple[int, ...]) -> None:
    """M R M is the rotation of the quaternion that the page's table names, of entries 1 to 4 with their signs."""
    from scipy.spatial.transform import Rotation

    q = Rotation.random(random_state=3).as_quat()
    turn = Rotation.from_quat([np.sign(i) * q[abs(i) - 1] for i in mirrored])
    m = np.array(mirror, dtype=float)
    assert np.allclose(m @ Rotation.from_quat(q).as_matrix() @ m, turn.as_matrix(), atol=1e-14)


def test_a_rate_that_is_none() -> None:
    with ExitStack() as stack, pytest.raises(InputError, match="a rate of 1 to 120 Hz"):
        stream_of(stack, rate=500.0, port=0)


def test_what_goes_out_by_lsl_comes_in() -> None:
    """Samples are rows of the run, with the times of their ticks; markers have the times that they were given."""
    pytest.importorskip("pylsl", reason="LSL: pip install 'graspfx[lsl]'")
    lsl = load_lsl()
    rows, markers = RowStream("rows of a test"), LslMarkers("markers of a test")
    scene = gx.load("reference-1dof", {"engine": "interpreted"})
    with LiveRun(scene) as run:
        rows.attach(run)
        streams = [lsl.resolve_byprop("source_id", each.source, timeout=60.0)
                 for each in (rows, markers)]  # fmt: skip
        if not all(streams):
            pytest.skip("no multicast on this machine, by which LSL finds streams")
        inlets = [lsl.StreamInlet(each[0]) for each in streams]
        for inlet in inlets:
            inlet.open_stream(timeout=60.0)
        labels = rows.channels
        assert labels[:2] == ["finger_position.finger0.x", "finger_position.finger1.x"]
        samples = [inlets[0].pull_sample(timeout=60.0) for _ in range(10)]
        now = time.monotonic()
        markers.mark(Event(now, 3, "stimulus", 1))
        text, clock = inlets[1].pull_sample(timeout=60.0)
        assert text == ["3 stimulus 1"] and abs(clock - now) < 0.01  # two clocks of one machine
        first, block = run.rows(0)
        columns = run.layout.columns
        positions = block[:, columns["finger_position"].where]
        forces, wall = block[:, columns["finger_force"].where], block[:, columns["wall"].where][:, 0]
        rows.detach()
    rows.close()
    times = []
    for values, clock in samples:
        (k,) = np.flatnonzero((positions == values[:2]).all(axis=1) & (forces == values[2:4]).all(axis=1))[:1]
        times.append(clock - wall[k])
    assert first == 0 and np.ptp(times) < 0.05  # one zero, but for the first look at it
    assert np.all(np.diff([clock for _, clock in samples]) > 0.0)


def test_rows_of_another_layout_have_a_stream_of_their_own() -> None:
    pytest.importorskip("pylsl", reason="LSL: pip install 'graspfx[lsl]'")
    streams = []
    with RowStream("rows of three runs") as rows:
        for name in ("reference-1dof", "reference-1dof", "paper-waving"):
            with LiveRun(gx.load(name, {"engine": "interpreted"})) as run:
                rows.attach(run)
                rows.samples = 0
                wait_until(lambda: rows.samples > 0)
                rows.detach()
            streams.append((rows.source, len(rows.channels)))
    assert streams[0] == streams[1] and streams[2][0] != streams[1][0]
    assert [width for _, width in streams] == [2 + 2 + 2 + 1, 2 + 2 + 2 + 1, 4 + 4 + 2 + 2]  # fingers' and an object's


def test_lsl_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pylsl", None)
    with pytest.raises(MissingPackageError, match=r"graspfx\[lsl\]"):
        load_lsl()
