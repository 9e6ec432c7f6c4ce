"""Things that are plugged in, by names of files in a root of the test's own; nothing is opened."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from graspfx.__main__ import main
from graspfx.commands import devices
from graspfx.machine import plugged
from graspfx.machine.plugged import hints_of, library_at, sightings
from graspfx.plugins import names
from tests.support.optional import require

TEENSY = "usb-Teensyduino_USB_Serial_1234-if00"
MOUSE = "usb-Maker_Mouse-event-mouse"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Make a machine with a rig, a port of nobody's, and a mouse: pipes, which an open would wait at for ever."""
    for folder in ("dev/serial/by-id", "dev/input/by-id", "usr/lib/x86_64-linux-gnu"):
        (tmp_path / folder).mkdir(parents=True)
    for port in ("ttyACM0", "ttyUSB3", "input/event5"):
        os.mkfifo(tmp_path / "dev" / port)
    (tmp_path / "dev/serial/by-id" / TEENSY).symlink_to("../../ttyACM0")
    (tmp_path / "dev/input/by-id" / MOUSE).symlink_to("../event5")
    (tmp_path / "usr/lib/x86_64-linux-gnu/libdrd.so").write_text("no library: to load it would fail")
    return tmp_path


def test_each_driver_has_a_line_with_what_there_is_and_how_a_scene_names_it(root: Path) -> None:
    listing = sightings(root)
    assert {each.driver for each in listing} == {*names("devices"), "-"}
    lines = {each.driver: each for each in listing}
    port = f"/dev/serial/by-id/{TEENSY}"
    assert lines["rig"].sight == port
    assert lines["rig"].device == f'{{ name = "rig", port = "{port}" }}'
    assert lines["mouse"].device == f'{{ name = "mouse", port = "/dev/input/by-id/{MOUSE}" }}'
    assert lines["gamepad"].sight == lines["haply-2diy"].sight == "no matching device is connected"
    assert lines["force-dimension"].sight.endswith("usr/lib/x86_64-linux-gnu/libdrd.so")
    assert "not queried" in lines["haply-inverse"].sight
    assert lines["simulated"].sight == "a simulation"
    assert lines["-"].sight == "/dev/ttyUSB3: matches no driver"
    assert sum("ttyACM0" in each.sight for each in listing) == 0  # it is the rig's, by its longer name


def test_a_machine_without_anything_says_so(tmp_path: Path) -> None:
    lines = {each.driver: each for each in sightings(tmp_path)}
    assert lines["rig"].sight == "no matching device is connected"
    assert lines["force-dimension"].sight.startswith("no libdrd.so")
    assert not any(each.device for name, each in lines.items() if name in ("rig", "mouse", "force-dimension"))


def test_a_driver_whose_package_is_not_installed_says_what_to_install(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plugged, "version", lambda package: None)
    lines = {each.driver: each for each in sightings(root)}
    text = "the package websockets is not installed: pip install 'graspfx[inverse]'"
    assert (lines["haply-inverse"].sight, lines["haply-inverse"].device) == (text, "")
    assert lines["simulated"].sight == "a simulation"  # it needs none


def test_every_driver_of_the_shelf_has_hints() -> None:
    for driver, origin in names("devices").items():
        if origin.startswith("GraspFX"):
            assert hints_of(driver), driver


def test_libraries_are_looked_for_where_the_loader_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sdk").mkdir()
    (tmp_path / "sdk/libown.so").write_text("")
    assert library_at(["libown.so"], tmp_path) is None
    monkeypatch.setenv("LD_LIBRARY_PATH", f"/nowhere{os.pathsep}{tmp_path / 'sdk'}")
    assert require(library_at(["libown.so"], tmp_path)).name == "libown.so"


def test_the_command_prints_a_table(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(devices, "sightings", lambda: sightings(root))
    assert main(["devices"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["driver", "found", "in", "a", "scene"]
    row = next(line for line in lines if line.startswith("rig"))
    assert row.endswith(f'device = {{ name = "rig", port = "/dev/serial/by-id/{TEENSY}" }}')
    assert main(["devices", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert {"driver": "simulated", "sight": "a simulation", "device": '{ name = "simulated" }'} in table
