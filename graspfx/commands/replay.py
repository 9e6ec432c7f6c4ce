"""graspfx replay: recompute forces and objects from the recorded motion of the fingers, and compare the results."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_options, add_values
from graspfx.commands.arguments import recording as recording_argument
from graspfx.commands.destination import add_destination, name_files, require_room_of
from graspfx.commands.output import REFUSED, SUCCESS, is_quiet, note, print_json, say_source
from graspfx.recording.files import NAME, make_folder, recording_file

if TYPE_CHECKING:
    from graspfx.assembly.replay_recording import Replay

EXAMPLE = """  graspfx replay out/latest
  graspfx replay out/latest --set coupling.internal.stiffness=80 --out out/stiffer"""
OPEN_LOOP = "open loop: the fingers follow the recorded motion and do not respond to the new forces"


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("recording", metavar="RECORDING", type=recording_argument, help="a recording, or its folder")
    add_values(parser)
    add_destination(parser, "DIR", "folder for the replay's recording.h5 (default: write nothing)")
    add_options(parser, ("--json", "print the comparison as JSON only"))


def execute(options: Namespace) -> int:
    from graspfx.assembly.replay_recording import replayed_with
    from graspfx.recording.record import Recording

    source, out = recording_file(options.recording), options.out
    if out is not None:
        require_room_of(options, out / NAME)
    recording = Recording.load(source)
    say_source(options.recording, source, recording)
    replay = replayed_with(recording, dict(options.overrides))
    if options.json:
        print_json(_table(replay))
    elif not is_quiet():
        for line in _lines(replay):
            print(line)
    if out is not None:
        file: Path = make_folder(out) / NAME
        replay.recording.save(file, overwrite=options.overwrite)
        name_files([file])
    if replay.is_open_loop or not replay.differences:
        return SUCCESS
    note(_reasons(replay))
    return REFUSED


def _lines(replay: Replay) -> Iterator[str]:
    """Yield the result of the comparison as lines of text, with one line for each column that differs."""
    original, count = replay.original, len(replay.columns)
    text = f"{original.header.scene or 'a recording'}: {len(original)} ticks, {count} columns replayed"
    if replay.is_open_loop:
        yield f"{text}; {OPEN_LOOP}"
        yield from (f"  {each}" for each in replay.differences)
        if not replay.differences:
            yield "  no difference"
    elif replay.differences:
        yield f"{text}; {len(replay.differences)} of them differ from the recording"
        yield from (f"  {each}" for each in replay.differences)
    else:
        yield f"{text}; all are equal to the recording, bit for bit: largest difference 0"


def _reasons(replay: Replay) -> Iterator[str]:
    """Yield differences between the versions and machines of recording and replay, which may explain other results."""
    then, now = replay.original.header, replay.recording.header
    for name, version in then.versions.items():
        if now.versions.get(name, version) != version:
            yield f"recorded with {name} {version}; this is {now.versions[name]}"
    for name, value in then.machine.items():
        if now.machine.get(name, value) != value:
            yield f"recorded on {name} {value}; this is {now.machine[name]}: other libraries may round differently"


def _table(replay: Replay) -> dict[str, object]:
    return {
        "scene": replay.original.header.scene,
        "ticks": len(replay.original),
        "columns": len(replay.columns),
        "open_loop": replay.is_open_loop,
        "identical": not replay.differences,
        "differences": [
            {"column": each.column, "largest": _finite(each.largest), "unit": each.unit, "tick": each.tick}
            for each in replay.differences
        ],
    }


def _finite(number: float) -> float | None:
    return number if abs(number) < float("inf") else None
