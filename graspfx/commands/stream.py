"""graspfx stream: a scene runs, and other programs have its states, by a WebSocket or the Lab Streaming Layer."""

from __future__ import annotations

import os
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Literal

from graspfx.commands.arguments import add_scene
from graspfx.commands.destination import add_destination, require_room_of
from graspfx.commands.interrupt import interruptible
from graspfx.commands.output import FAULTS, SUCCESS, doubts, name_files, note, warn_of_hardware
from graspfx.errors import InputError
from graspfx.progress import waiting
from graspfx.recording.files import NAME

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.scene.model import Scene

EXAMPLE = """  graspfx stream paper-waving
  graspfx stream sphere-three-fingers --goals --rate 90
  graspfx stream paper-waving --lsl"""
RATE = 60.0  # of states [Hz]
TOKEN = "GRASPFX_TOKEN"  # of the environment: an argument can be read by everybody on the machine
LOOK = 0.1  # between two looks whether to end [s]


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    parser.add_argument("--rate", metavar="HZ", type=float, default=RATE, help="of states, 1 to 120 (60)")
    parser.add_argument("--goals", action="store_true", help="let clients lead the hands of simulated fingers")
    add_stream(parser)
    parser.add_argument("--lsl", action="store_true", help="stream rows by the Lab Streaming Layer, too")
    parser.add_argument("--seconds", metavar="S", type=float, help="after which it ends by itself")
    add_destination(parser, "DIR", f"folder of {NAME}; nothing is recorded if not given")


def add_stream(parser: ArgumentParser) -> None:
    """Add --port, --lan, --token and --origin."""
    parser.add_argument("--port", metavar="N", type=int, help="of the stream (the first that is free from 8770 on)")
    parser.add_argument("--lan", action="store_true", help="let programs of other machines in the network in, too")
    secret = f"that clients bring, 16 letters or more; or ${TOKEN}, which others cannot see (a new one is printed)"
    parser.add_argument("--token", metavar="TEXT", help=secret)
    pages = "let a browser's page from there open the stream, as http://localhost:5000"
    parser.add_argument("--origin", metavar="URL", action="append", default=[], help=pages)


def execute(options: Namespace) -> int:
    from graspfx.assembly.resolve import resolve
    from graspfx.live.live_run import LiveRun
    from graspfx.live.stream.stream_socket import stream_of
    from graspfx.scene.load import load
    from graspfx.screen.socket_thread import require_websockets

    if options.seconds is not None and not options.seconds > 0.0:
        raise InputError("--seconds", options.seconds, "a time above zero")
    require_websockets("a stream")
    if options.out is not None:
        require_room_of(options, options.out / NAME)
    with waiting(f"checking {options.scene}"):
        scene = load(options.scene, dict(options.overrides), preset=options.preset)
        parts = resolve(scene)
        notes = doubts(scene)
    note(notes)
    if options.goals and parts.hardware:
        do = "where a person's hand is, nobody else leads"
        raise InputError("--goals", "a scene with hardware", "simulated fingers alone", do)
    guide: Literal["hands", "fingers"] = "hands" if scene.hand else "fingers"
    with interruptible() as stop, ExitStack() as stack:
        stream, address = stream_of(
            stack, rate=options.rate, goals=options.goals, port=options.port, lan=options.lan,
            token=options.token or os.environ.get(TOKEN) or None, origins=options.origin,
        )  # fmt: skip
        if parts.hardware:
            warn_of_hardware()
        with waiting(f"starting {options.scene}"):
            run = stack.enter_context(LiveRun(scene, out=options.out, guide=guide if options.goals else None))
        if run.has_hardware:
            _tell("HARDWARE IS ARMED")
        stream.attach(run)
        stack.callback(stream.detach)
        if options.lsl:
            _stream_rows(scene, run, stack)
        _tell(f"{address}\nthe token is the stream's key; Ctrl-C ends it")
        _wait(run, stop, options.seconds)
        fault = str(run.fault.message) if run.fault is not None else run.cause
    if options.out is not None:
        name_files([options.out / NAME])
    if fault:
        print(fault, file=sys.stderr)
    return FAULTS if fault else SUCCESS


def _stream_rows(scene: Scene, run: LiveRun, stack: ExitStack) -> None:
    from graspfx.live.lsl_outlet import RowStream

    rows = stack.enter_context(RowStream(f"GraspFX {scene.source.name}"))
    rows.attach(run)
    stack.callback(rows.detach)
    _tell(f"LSL: {len(rows.channels)} channels at {rows.rate:g} Hz")


def _wait(run: LiveRun, stop: Callable[[], bool], seconds: float | None) -> None:
    end = None if seconds is None else time.monotonic() + seconds
    while not stop() and run.state != "ended" and run.fault is None and (end is None or time.monotonic() < end):
        time.sleep(LOOK)


def _tell(text: str) -> None:
    print(text)
    sys.stdout.flush()
