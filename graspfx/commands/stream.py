"""graspfx stream: run a scene, and stream states over a WebSocket or the Lab Streaming Layer."""

from __future__ import annotations

import os
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Literal

from graspfx.commands.arguments import add_options, add_scene, checked_scene, seconds_of
from graspfx.commands.destination import add_destination, name_files, require_room_of
from graspfx.commands.output import FAULTS, SUCCESS, interruptible, tell, warn_of_hardware
from graspfx.errors import InputError
from graspfx.progress import waiting
from graspfx.recording.files import NAME

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun
    from graspfx.scene.model import Scene

EXAMPLE = """  graspfx stream paper-waving
  graspfx stream sphere-three-fingers --goals --rate 90
  graspfx stream paper-waving --lsl"""
RATE = 60.0  # default rate of states [Hz]
TOKEN = "GRASPFX_TOKEN"  # environment variable with the token: other users of the machine can read an argument
LOOK = 0.1  # interval between checks whether to end [s]


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    add_options(
        parser,
        ("--rate HZ", "rate of states [Hz], 1 to 120 (default: 60)", float, RATE),
        ("--goals", "allow clients to move the hands of simulated fingers"),
        ("--port N", "port of the stream (default: the first free one from 8770)", int),
        ("--lan", "accept programs on other machines in the network"),
        (
            "--token TEXT",
            f"token for clients, at least 16 letters (default: the environment variable {TOKEN}, or a new token)",
        ),
    )
    pages = "origin of a web page that may open the stream, such as http://localhost:5000"
    parser.add_argument("--origin", metavar="URL", action="append", default=[], help=pages)
    add_options(
        parser,
        ("--lsl", "also stream rows over the Lab Streaming Layer"),
        ("--seconds S", "time after which the command ends [s]", float),
    )
    add_destination(parser, "DIR", f"folder of {NAME} (default: record nothing)")


def execute(options: Namespace) -> int:
    from graspfx.assembly.resolve import resolve
    from graspfx.live.live_run import LiveRun
    from graspfx.live.state_stream import stream_of
    from graspfx.screen.claim_server import require_websockets

    seconds = seconds_of(options)
    require_websockets("a stream")
    if options.out is not None:
        require_room_of(options, options.out / NAME)
    scene = checked_scene(options)
    parts = resolve(scene)
    if options.goals and parts.hardware:
        do = "clients must not move a finger that a person holds"
        raise InputError("--goals", "a scene with hardware", "simulated fingers only", do)
    guide: Literal["hands", "fingers"] = "hands" if scene.hand else "fingers"
    with interruptible() as stop, ExitStack() as stack:
        stream, address = stream_of(
            stack, rate=options.rate, goals=options.goals, port=options.port, lan=options.lan,
            token=options.token or os.environ.get(TOKEN) or None, origins=options.origin,
        )  # fmt: skip
        if parts.hardware:
            warn_of_hardware()
        with waiting(f"starting {options.scene}"):
            own = guide if options.goals else None
            run = stack.enter_context(LiveRun(scene, out=options.out, overwrite=options.overwrite, guide=own))
        if run.has_hardware:
            tell("HARDWARE IS ARMED")
        stream.attach(run)
        stack.callback(stream.detach)
        if options.lsl:
            _stream_rows(scene, run, stack)
        tell(f"{address}\nanyone with the token can open the stream; Ctrl-C ends it")
        _wait(run, stop, seconds)
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
    tell(f"LSL: {len(rows.channels)} channels at {rows.rate:g} Hz")


def _wait(run: LiveRun, stop: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    while not stop() and run.state != "ended" and run.fault is None and time.monotonic() < end:
        time.sleep(LOOK)
