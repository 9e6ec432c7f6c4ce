"""The Haply Inverse service: one connection, one answer for each message, lost ones, and devices set otherwise."""

from __future__ import annotations

import itertools
import json
import re
import socket
import subprocess
import sys
import threading
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.http11 import Request
from websockets.server import ServerProtocol

from graspfx.devices.haply_inverse import service, websocket
from graspfx.devices.haply_inverse.emulator import InverseWire
from graspfx.devices.haply_inverse.service import check_config, devices_in, forces_text, position_in
from graspfx.devices.haply_inverse.websocket import WebSocket
from graspfx.errors import DeviceError, InputError
from graspfx.protocols import QuenchableDriver
from graspfx.testing import check_device, driver
from tests.support.hardware import VirtualClock

PERIOD = 0.002
FORCE = np.array([[0.2, -0.1, 0.3]])
WIRES: dict[str, InverseWire] = {}  # on clocks of their own, by their addresses


def on_clock(devices: tuple[str, ...] = ("049D",), **settings: Any) -> InverseWire:
    """Make a service on a clock of its own."""
    wire = InverseWire(devices, clock=VirtualClock(), **settings)
    WIRES[wire.url] = wire
    return wire


class Texts:
    """A connection to a service on a clock of its own: without a socket, and without a wait."""

    opened = 0

    def __init__(self, wire: InverseWire) -> None:
        self.wire, self.url, self.now = wire, wire.url, wire.clock.now
        self._unread, self._due = list[str](), list[tuple[float, bytes]]()

    def open(self) -> None:
        Texts.opened += 1
        self._due = [(self.now(), self.wire.state(first=True))]

    def send(self, text: str) -> None:
        self._unread.append(text)
        self._work()

    def receive(self, deadline: float) -> str | None:
        self._work()
        while not (self._due and self._due[0][0] <= self.now()):
            if self.now() >= deadline:
                return None
            self.wire.clock.sleep(min(2e-4, deadline - self.now()) + 1e-12)
        return self._due.pop(0)[1].decode(errors="replace")

    def close(self) -> None:
        self._unread, self._due = [], []

    def _work(self) -> None:
        while self._unread and self.wire.failure != "blocked":
            self._due += self.wire.answer(self._unread.pop(0).encode())


@pytest.fixture(autouse=True)
def _lines(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lead connections to services on clocks of their own."""
    real = service._websocket
    monkeypatch.setattr(service, "_websocket", lambda url: Texts(WIRES[url]) if url in WIRES else real(url))
    monkeypatch.setattr(service, "_services", {})
    monkeypatch.setattr(Texts, "opened", 0)


def connect(wire: InverseWire, **settings: Any) -> Any:
    return driver("haply-inverse").connect(**{"timeout": 0.001, **wire.settings, **settings})


def tick(*devices: Any, force: Any = FORCE) -> list[Any]:
    """Run a sample as the servo does, a period later: all are asked, then read, then written."""
    VirtualClock.time += PERIOD
    for device in devices:
        device.ask()
    readings = [device.read() for device in devices]
    for device in devices:
        device.write(force)
    return readings


def tick_often(*devices: Any, count: int = 1000) -> list[float]:
    """Run samples; give the times of the first device's readings."""
    return [tick(*devices)[0][2] for _ in range(count)]


@pytest.mark.alone
def test_it_keeps_the_promises_of_a_device() -> None:
    with InverseWire() as wire:
        report = check_device(lambda: connect(wire, timeout=0.05), wire)
    assert "a force reaches its own finger, in its direction, in newtons" in report.checks
    assert "the device's force ends without further writes" in report.checks
    for kind in wire.kinds:
        assert any(f"({kind})" in each for each in report.checks)


def test_messages_are_those_of_the_service() -> None:
    text = forces_text({"049D": (0.5, 0.0, -1.0)})
    assert json.loads(text) == {
        "inverse3": [
            {
                "device_id": "049D",
                "commands": {"set_cursor_force": {"values": {"x": 0.5, "y": 0.0, "z": -1.0}}},
            }
        ]
    }
    state = '{"session_id":7,"inverse3":[{"device_id":"049D","state":{"cursor_position":{"x":0.1,"z":-0.2}}}]}'
    devices = devices_in(state)
    assert devices is not None
    assert position_in(devices["049D"]) == (0.1, 0.0, -0.2)  # what is zero is left out


@pytest.mark.parametrize(
    "position",
    [
        None, {}, [], [0.1, 0.2, 0.3], "0.1", {"w": 1.0}, {"x": None}, {"x": "0.1"}, {"x": True}, {"x": float("nan")},
        {"x": float("inf"), "y": 0.0}, {"x": {"y": 1}},
    ],
)  # fmt: skip
def test_what_is_no_position_is_none_and_never_zero(position: Any) -> None:
    assert position_in({"device_id": "a", "state": {"cursor_position": position}}) is None
    assert position_in({"device_id": "a", "state": position}) is None
    assert position_in({"device_id": "a"}) is None


@pytest.mark.parametrize(
    "text", ["", "{", "null", "7", "[]", '{"inverse3":7}', '{"inverse3":{}}', "\x00", "[" * 100_000]
)
def test_what_is_no_message_is_none(text: str) -> None:
    assert devices_in(text) is None or text == "null"
    assert devices_in('{"inverse3":[null,7,{"device_id":3},{"device_id":"a"}]}') == {"a": {"device_id": "a"}}


def test_all_devices_of_a_service_share_a_connection_and_a_message() -> None:
    """Two questions a tick go out, one for all: at its beginning and after the last has written."""
    with on_clock(("A", "B", "C")) as wire:
        devices = [connect(wire, device=name) for name in wire.devices]
        for device in devices:
            device.open(PERIOD)
        before = len(wire.messages)
        for _ in range(10):
            readings = tick(*devices)
        assert len(wire.messages) == before + 20
        assert [each["device_id"] for each in json.loads(wire.messages[-1])["inverse3"]] == ["A", "B", "C"]
        assert [r[0][0, 0] for r in readings] == pytest.approx([0.03, 0.13, 0.23])
        assert Texts.opened == 1
        devices[1].close()
        assert not wire.force_of("B").any()
        tick(devices[0], devices[2])
        assert wire.force_of("A").all() and wire.force_of("C").all()
        for device in devices:
            device.close()
        assert not any(wire.force_of(name).any() for name in wire.devices)
        devices[0].open(PERIOD)
        assert Texts.opened == 2  # the last one had closed it
        devices[0].close()


def test_one_that_is_stopped_leaves_the_others_as_they_are() -> None:
    with on_clock(("A", "B")) as wire, connect(wire, device="A") as a, connect(wire, device="B") as b:
        a.open(PERIOD)
        b.open(PERIOD)
        tick(a, b)
        assert wire.force_of("B").all()
        a.stop()
        assert not wire.force_of("A").any()
        assert wire.force_of("B") == pytest.approx(FORCE[0])


def test_a_lost_answer_holds_a_sample_and_stalls_nothing() -> None:
    """With every third one lost the loop goes on, and no sample is called younger than it is."""
    with on_clock() as wire, connect(wire) as device:
        device.open(PERIOD)
        wire.fail("drop", 3)
        times = []
        for _ in range(60):
            asked = device.service.now() + PERIOD
            times += [when + device._began for when in tick_often(device, count=1)]
            assert times[-1] <= asked + 1e-9
        fresh = sum(b > a for a, b in itertools.pairwise(times))
        assert fresh >= 30
        assert all(b >= a for a, b in itertools.pairwise(times))
        wire.heal()
        VirtualClock.time += 0.03
        assert tick_often(device, count=2)[-1] + device._began > asked


def test_a_stalled_answer_is_a_sample_that_stands() -> None:
    """10.7 ms, as a service was seen to take: some held samples, then all is as before."""
    with on_clock() as wire, connect(wire) as device:
        device.open(PERIOD)
        place = tick(device)[0][0].copy()
        wire.fail("late", 0.0107)
        times = tick_often(device, count=3)
        wire.heal()
        assert times[-1] == times[0]
        assert tick_often(device, count=10)[-1] > times[-1]
        assert device.read()[0] == pytest.approx(place)


def test_a_service_that_says_nothing_more_is_a_fault() -> None:
    with on_clock() as wire, connect(wire) as device:
        device.open(PERIOD)
        wire.fail("blocked")
        tick_often(device, count=30)
        with pytest.raises(DeviceError, match=r"no new position for 0.1 s"):
            tick_often(device, count=20)


def test_a_device_that_is_gone_is_a_fault_and_the_others_go_on() -> None:
    with on_clock(("A", "B")) as wire, connect(wire, device="A") as a, connect(wire, device="B") as b:
        a.open(PERIOD)
        b.open(PERIOD)
        tick(a, b)
        wire.remove("A")
        with pytest.raises(DeviceError, match="A is disconnected"):
            tick_often(a, b, count=3)
        first, second = tick_often(b, count=2)
        assert second > first


def test_a_position_that_no_hand_reaches_is_none() -> None:
    with on_clock() as wire, connect(wire) as device:
        device.open(PERIOD)
        place = tick(device)[0][0].copy()
        wire.place("049D", np.array([0.0, 5.0, 0.0]))
        position, velocity, _ = tick(device)[0]
        assert position == pytest.approx(place)
        assert not velocity.any()


def test_forces_are_clamped_in_their_direction_and_finite() -> None:
    with on_clock() as wire, connect(wire, force_limit=2.0) as device:
        device.open(PERIOD)
        tick(device, force=1e6 * FORCE)
        assert wire.torque == pytest.approx(2.0 * FORCE[0] / np.linalg.norm(FORCE))
        with pytest.raises(DeviceError, match="cannot be displayed"):
            device.write(np.array([[0.0, np.nan, 0.0]]))
        assert not wire.torque.any()


def test_the_force_outlives_a_connection_and_quench_takes_it() -> None:
    module = driver("haply-inverse")
    assert isinstance(module, QuenchableDriver)
    with on_clock(("A", "B")) as wire:
        device = connect(wire)
        device.open(PERIOD)
        tick(device)
        device.service._line.close()  # as if the program had died
        device._lock.release()
        assert wire.torque.any()
        module.quench(**wire.settings, force_limit=1.0)
        assert not wire.torque.any()
        with pytest.raises(DeviceError, match="set `device` to one of them"):
            module.quench(url=wire.url)
        wire.fail("blocked")
        with pytest.raises(DeviceError, match="does not answer: switch A off"):
            module.quench(**wire.settings)


@pytest.mark.parametrize(
    ("config", "setting", "text"),
    [
        ({"basis": {"permutation": "XZY"}}, {}, 'basis of 049D is "XZY".*expects XYZ'),
        ({"basis": "ZXY"}, {"basis": "YXZ"}, 'basis of 049D is "ZXY".*expects YXZ'),
        ({}, {"basis": "XZY"}, 'basis of 049D is "XYZ".*expects XZY'),
        ({"basis": {"permutation": 3}}, {}, "basis of 049D is 3"),
        ({"mount": {"transform": {"position": {"x": 0.1}}}}, {}, "mount of 049D"),
        ({"damping": {"scalar": 0.5}}, {}, "damping of 049D is 0.5.*0 N s/m"),
        ({"damping": 0.5}, {"damping": 0.4}, "damping of 049D is 0.5.*0.4 N s/m"),
        ({"damping": "much"}, {}, 'damping of 049D is "much"'),
        ({"force_gate": {"enabled": False}}, {}, "blocks the force"),
        ({"force_gate": 0.0}, {}, "blocks the force"),
    ],
)
def test_a_device_that_is_set_otherwise_is_refused(config: Any, setting: Any, text: str) -> None:
    with on_clock(config=config) as wire, pytest.raises(DeviceError, match=text):
        connect(wire, **setting).open(PERIOD)
    assert not wire.messages  # nothing was commanded


@pytest.mark.parametrize(
    ("config", "setting"),
    [
        (None, {}),
        ({"basis": {"permutation": "XZY"}, "damping": {"scalar": 0.3}}, {"basis": "XZY", "damping": 0.3}),
        ({"basis": {}, "mount": {"transform": {"rotation": {"w": 1, "x": 0}, "scale": {"x": 1}}}}, {}),
        ({"force_gate": 1.0, "more": [1, 2]}, {}),
    ],
)
def test_a_device_that_is_set_so_is_opened(config: Any, setting: Any) -> None:
    device = {"device_id": "a", "config": config}
    check_config(device, setting.get("basis", "XYZ"), setting.get("damping", 0.0))
    settings = driver("haply-inverse").connect(**setting)
    assert settings.features.friction == setting.get("damping")


def test_a_service_without_the_device_is_refused_with_those_it_has() -> None:
    with InverseWire(("A", "B")) as wire:
        with pytest.raises(DeviceError, match="has no device 'C'; it has A, B"):
            connect(wire, device="C").open(PERIOD)
        with pytest.raises(DeviceError, match="devices A, B: set"):
            connect(wire, device=None).open(PERIOD)
        url = wire.url
    with pytest.raises(DeviceError, match=r"no service answers .* check that it is running"):
        driver("haply-inverse").connect(url=url).open(PERIOD)


def test_a_second_program_is_refused() -> None:
    text = (
        "import sys; from graspfx.testing import driver; "
        "driver('haply-inverse').connect(url=sys.argv[1], device='049D').open(0.002)"
    )
    with InverseWire() as wire, connect(wire, timeout=1.0) as device:
        device.open(PERIOD)
        other = subprocess.run([sys.executable, "-c", text, wire.url], capture_output=True, text=True)
        assert "is taken by another program" in other.stderr
        assert tick(device)[0][0] == pytest.approx(wire.position)


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ({"url": "http://localhost:10001"}, "url"),
        ({"url": "ws://"}, "url"),
        ({"url": "ws://a:99999"}, "url"),
        ({"url": "ws://a:1/\r\nx"}, "url"),
        ({"device": ""}, "device"),
        ({"basis": "XXY"}, "basis"),
        ({"basis": ["X", "Y", "Z"]}, "basis"),
        ({"force_limit": 100.0}, "force_limit"),
        ({"damping": -1.0}, "damping"),
        ({"timeout": 0.0}, "timeout"),
    ],
)
def test_settings_are_refused_by_their_names(setting: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        driver("haply-inverse").connect(**setting)


WITHOUT = "import sys; sys.modules['websockets'] = None; import graspfx as gx; from graspfx.testing import driver; "
SCENE = """
dimensions = 3
period = 0.005
duration = 0.1
[object]
mass = 0.1
viscosity = 0.8
rotational_viscosity = 1e-3
shape = { kind = "box", size = [0.05, 0.05, 0.05] }
[coupling]
external = { stiffness = 30.0 }
internal = { stiffness = 70.0 }
[[finger]]
device = { name = "haply-inverse", device = "A" }
start = [-0.026, 0.0, 0.0]
[[finger]]
device = { name = "haply-inverse", device = "B" }
start = [0.026, 0.0, 0.0]
"""


@pytest.mark.parametrize(
    "call",
    [
        "driver('haply-inverse').connect()",
        "driver('haply-inverse').quench()",
        "from graspfx.testing.wire import InverseWire; InverseWire()",
    ],
)
def test_without_the_package_it_is_refused_with_what_to_install(call: str) -> None:
    other = subprocess.run([sys.executable, "-c", WITHOUT + call], capture_output=True, text=True)
    assert re.search(
        r"MissingPackageError: .*needs the package 'websockets', which is not installed; "
        r"pip install 'graspfx\[inverse\]'",
        other.stderr,
    )


@pytest.mark.parametrize("command", ["check SCENE", "run SCENE --real-time", "doctor haply-inverse"])
def test_commands_without_the_package_say_what_to_install(command: str, tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE, encoding="utf-8")
    words = command.replace("SCENE", str(scene)).split()
    text = f"{WITHOUT}from graspfx.__main__ import main; sys.exit(main({words}))"
    other = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, cwd=tmp_path)
    assert other.returncode not in (0, None) and "Traceback" not in other.stderr
    assert "websockets" in other.stderr and "pip install 'graspfx[inverse]'" in other.stderr


def test_the_extra_that_the_driver_names_brings_the_package_and_so_does_work_on_it() -> None:
    root = Path(__file__).parents[2]
    extras = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    hints = tomllib.loads((root / "devices/haply_inverse/hints.toml").read_text(encoding="utf-8"))
    for extra in (hints["extra"], "dev"):
        assert any(re.match(rf"{hints['package']}\b", each) for each in extras[extra])


# The WebSocket --------------------------------------------------------------------------------------------------------


def greet(line: socket.socket) -> None:
    """Answer the request for a WebSocket."""
    protocol = ServerProtocol()
    while not (requests := protocol.events_received()):
        protocol.receive_data(line.recv(1000))
    assert isinstance(requests[0], Request)
    protocol.send_response(protocol.accept(requests[0]))
    line.sendall(b"".join(protocol.data_to_send()))


class Peer:
    """A server that says what a test has it say, after a greeting that is right."""

    def __init__(self, *parts: bytes, greeting: bytes | None = None) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"ws://127.0.0.1:{self._server.getsockname()[1]}"
        self.seen = b""
        self._thread = threading.Thread(target=self._serve, args=(parts, greeting), daemon=True)
        self._thread.start()

    def _serve(self, parts: tuple[bytes, ...], greeting: bytes | None) -> None:
        line, _ = self._server.accept()
        with line:
            line.settimeout(60.0)
            try:  # the other end closes when it has seen enough
                if greeting is None:
                    greet(line)
                else:
                    line.sendall(greeting)
                    line.shutdown(socket.SHUT_WR)  # the end of an answer without a length
                for part in parts:
                    line.sendall(part)
                    time.sleep(0.002)
                while data := line.recv(1000):
                    self.seen += data
            except OSError:
                pass

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *exc: object) -> None:
        self._thread.join()
        self._server.close()


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine may be late for a greeting."""
    monkeypatch.setattr(websocket, "PATIENCE", 60.0)


def soon() -> float:
    return time.perf_counter() + 60.0


def test_texts_come_whole_however_they_are_cut() -> None:
    long = b"x" * 70_000
    frames = b"\x81\x02hi" + b"\x01\x01a\x00\x01b\x89\x01!\x80\x01c" + b"\x81\x7f" + len(long).to_bytes(8, "big") + long
    for cut in (1, 3, 7, 5000):
        pieces = [frames[:cut], frames[cut:20], frames[20:]] if cut < 20 else [frames[:cut], frames[cut:]]
        with Peer(*pieces) as peer:
            line = WebSocket(peer.url)
            line.open()
            assert [line.receive(soon()), line.receive(soon())] == ["hi", "abc"]
            assert line.receive(soon()) == long.decode()
            assert line.receive(time.perf_counter() + 0.01) is None
            line.close()
            line.close()
        assert peer.seen[:2] == b"\x8a\x81"  # the answer to a ping, masked


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"\x88\x00", "has closed"),
        (b"\x81\x82abcdef", "violate the WebSocket"),
        (b"\xf1\x00", "violate the WebSocket"),
        (b"\x83\x00", "violate the WebSocket"),
        (b"\x80\x00", "violate the WebSocket"),
        (b"\x81\x7f\xff\xff\xff\xff\xff\xff\xff\xff", "a message of more"),
        ((b"\x01\x7f" + (1 << 20).to_bytes(8, "big") + bytes(1 << 20)) * 2, "a message of more"),
    ],
)
def test_what_is_no_message_is_a_fault(data: bytes, text: str) -> None:
    with Peer(data) as peer:
        line = WebSocket(peer.url)
        line.open()
        with pytest.raises(DeviceError, match=text):
            assert [line.receive(soon()) for _ in range(3)] == []
        line.close()


@pytest.mark.parametrize("data", [b"\x88\x00", b"\xf1\x00", b"\x81\x82abcdef"])
def test_a_text_goes_out_also_after_the_protocol_was_broken(data: bytes) -> None:
    """A force of zero has to reach a service that has said nonsense, or that has said goodbye and reads on."""
    with Peer(b"\x81\x02hi" + data) as peer:
        line = WebSocket(peer.url)
        line.open()
        assert line.receive(soon()) == "hi"  # that came before, in one piece with it
        for _ in range(2):
            with pytest.raises(DeviceError, match=r"violate the WebSocket|has closed"):
                line.receive(soon())
        line.send("zero")
        line.close()
    assert [bytes([peer.seen[0], peer.seen[1]]), peer.seen[10:12]] == [b"\x81\x84", b"\x88\x80"]
    key, text = peer.seen[2:6], peer.seen[6:10]
    assert bytes(a ^ b for a, b in zip(key, text, strict=True)) == b"zero"


@pytest.mark.parametrize(
    "greeting",
    [
        b"HTTP/1.1 404 Not Found\r\n\r\n",
        b"HTTP/1.1 101 Switching\r\nSec-WebSocket-Accept: x\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nhi",
        b"\r\n\r\n",
        b"\0" * 70_000,
    ],
)
def test_what_greets_as_no_websocket_is_refused(greeting: bytes) -> None:
    with Peer(greeting=greeting) as peer, pytest.raises(DeviceError, match="not a WebSocket server"):
        WebSocket(peer.url).open()


def test_texts_of_every_length_arrive_as_they_were_sent() -> None:
    with InverseWire() as wire:
        line = WebSocket(wire.url)
        line.open()
        line.receive(soon())
        for size in (0, 1, 3, 125, 126, 127, 65_535, 65_536):
            line.send("é" * (size // 2) + "x" * (size % 2))
            assert line.receive(soon()) is not None
            assert wire.messages[-1] == "é" * (size // 2) + "x" * (size % 2)
        line.close()


def test_a_silent_peer_is_no_service(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(websocket, "PATIENCE", 0.1)
    server = socket.create_server(("127.0.0.1", 0))
    with pytest.raises(DeviceError):
        WebSocket(f"ws://127.0.0.1:{server.getsockname()[1]}").open()
    server.close()


@pytest.mark.parametrize("ending", ["blocked", "unplugged", "close"])
def test_an_emulated_service_whose_client_does_not_read_can_fail_and_end(ending: Any) -> None:
    """Its answers are more than the system takes for a client: some 18 MB."""
    with InverseWire([f"{i:04X}" for i in range(50)]) as wire, socket.socket() as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.connect(("127.0.0.1", int(wire.url.rpartition(":")[2])))
        client.sendall(
            b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        )
        client.sendall(3000 * b"\x81\x82\0\0\0\0{}")
        count = -1
        while count < len(wire.messages):  # until all are answered, or an answer waits for the client
            count = len(wire.messages)
            time.sleep(1.0)
        acting = threading.Thread(target=wire.close if ending == "close" else lambda: wire.fail(ending), daemon=True)
        acting.start()
        acting.join(20.0)
        assert not acting.is_alive()
