"""graspfx touch: run a scene whose fingers follow touches on a screen. The force is shown, not felt."""

from __future__ import annotations

import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_options, add_scene, checked_scene, seconds_of
from graspfx.commands.destination import add_destination, name_files, require_room, require_room_of
from graspfx.commands.output import FAULTS, SUCCESS, interruptible, tell
from graspfx.progress import waiting
from graspfx.recording.files import NAME
from graspfx.system import terminal

if TYPE_CHECKING:
    from socket import socket

    from graspfx.screen.gate import Gate

EXAMPLE = """  graspfx touch paper-waving
  graspfx touch paper-waving --lan"""
LOG = "touches.csv"
INVITATION = "hold the object with two fingers on the page; the force is shown, not felt. Ctrl-C ends the run"


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    add_options(
        parser,
        ("--lan", "serve a tablet in the same network; each printed code admits one screen"),
        ("--port N", "port of the page (default: the first free one from 8765)", int),
        ("--seconds S", "time after which the command ends [s]", float),
    )
    add_destination(parser, "DIR", f"folder of {NAME} and {LOG} (default: record nothing)")


def execute(options: Namespace) -> int:
    from graspfx.live.touch_run import TouchRun
    from graspfx.screen.claim_server import require_websockets
    from graspfx.screen.gate import HOST, code, gate_for, listen, network_address

    seconds = seconds_of(options)
    require_websockets()
    if options.lan:
        code("")  # raises for a missing package before the scene starts
    if options.out is not None:
        require_room_of(options, options.out / NAME)
        require_room(options, [options.out / LOG])
    with listen(network_address() if options.lan else HOST, options.port) as line:
        gate = gate_for(line, lan=options.lan)
        scene = checked_scene(options)
        with waiting(f"starting {options.scene}"):
            touch = TouchRun(scene, line, gate, out=options.out, overwrite=options.overwrite)
        with interruptible() as stop, touch:
            _invite(line, gate)
            tell(INVITATION)
            touch.wait(_looks(stop, line, gate, seconds))
            fault = touch.fault
    if options.out is not None:
        name_files([options.out / NAME, options.out / LOG])
    if fault:
        print(fault, file=sys.stderr)
    return FAULTS if fault else SUCCESS


def _invite(line: socket, gate: Gate) -> None:
    """Print the address of the page; with --lan, it contains a token for one screen and is also shown as a QR code."""
    from graspfx.screen.gate import code, url

    if not gate.locked:
        tell(url(line))
        return
    address = url(line, gate.renew())
    tell(f"{code(address)}\n{address}\nvalid for one screen and ten minutes; press Enter for another code")


def _looks(stop: Callable[[], bool], line: socket, gate: Gate, seconds: float) -> Callable[[], bool]:
    """Return a function that returns whether the command must end: after Ctrl-C, or at the end of --seconds.

    If screens can connect over a network, the returned function also prints a new code for connections whenever Enter
    is pressed.
    """
    end = time.monotonic() + seconds
    is_open = gate.locked and terminal.is_watched()

    def look() -> bool:
        if is_open and terminal.takes_line():
            _invite(line, gate)
        return stop() or time.monotonic() > end

    return look
