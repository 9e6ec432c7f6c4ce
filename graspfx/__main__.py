"""The graspfx command: run, check, list, schema and plot."""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx.errors import GraspFXError

if TYPE_CHECKING:
    from graspfx.loop.record import Recording

DONE, WRONG, FAULTS, INTERRUPTED = 0, 2, 3, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; the exit code is 0, 2 for an error, 3 for a run with faults, 130 when interrupted."""
    chosen = parser().parse_args(arguments)
    try:
        code: int = chosen.command(chosen)
        sys.stdout.flush()
    except BrokenPipeError:  # who reads has left, as in `graspfx schema | head`: nothing more to say, at exit neither
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return WRONG
    except GraspFXError as error:
        print(error, file=sys.stderr)
        return WRONG
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    return code


def parser() -> ArgumentParser:
    top = ArgumentParser(prog="graspfx", description="Haptic display of grasping.")
    commands = top.add_subparsers(title="commands", metavar="COMMAND", required=True)

    run = commands.add_parser("run", help="simulate a scene, record it and sum it up")
    run.set_defaults(command=_run)
    _add_scene(run)
    run.add_argument("--duration", metavar="S", type=float, help="seconds to simulate instead of the scene's own")
    run.add_argument("--out", metavar="DIR", type=Path, help="folder of recording.h5 and figure.png (out/SCENE)")
    run.add_argument("--no-figure", action="store_true", help="draw nothing")
    run.add_argument("--json", action="store_true", help="print the summary as JSON, and nothing else")

    check = commands.add_parser("check", help="show a scene's faults, or what each sample will do and why")
    check.set_defaults(command=_check)
    _add_scene(check)

    listing = commands.add_parser("list", help="name the scenes, devices and dynamics at hand")
    listing.set_defaults(command=_list)

    schema = commands.add_parser("schema", help="print the JSON schema of a scene")
    schema.set_defaults(command=_schema)

    plot = commands.add_parser("plot", help="draw one recording, or two side by side")
    plot.set_defaults(command=_plot)
    plot.add_argument("recordings", metavar="RECORDING", nargs="+", type=Path, help="one or two recording.h5")
    plot.add_argument("--out", metavar="DIR", type=Path, help="folder of the picture (that of the first recording)")
    return top


def override(text: str) -> tuple[str, Any]:
    """KEY=VALUE as a key and a value: TOML where it reads as TOML, else the text itself."""
    import tomllib

    key, equals, value = text.partition("=")
    if not key.strip() or not equals:
        raise ArgumentTypeError(f"{text!r} is not of the form KEY=VALUE")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value


def _add_scene(command: ArgumentParser) -> None:
    command.add_argument("scene", metavar="SCENE", help="a scene's name, or the path of a .toml or .py file")
    values = command.add_argument("--set", metavar="KEY=VALUE", type=override, action="extend", nargs="+", default=[])
    values.dest, values.help = "overrides", "replace values of the scene, by dotted keys"


def _run(chosen: Namespace) -> int:
    from graspfx.scene.load import load
    from graspfx.scene.run import run

    scene = load(chosen.scene, dict(chosen.overrides))
    folder: Path = chosen.out or Path("out") / Path(chosen.scene).stem
    recording = run(scene, duration=chosen.duration, out=folder)
    written = [folder / "recording.h5"]
    if not chosen.no_figure:
        from graspfx.show.plot import figure

        written.append(folder / "figure.png")
        figure([recording], written[-1])
    if chosen.json:
        _print_json(recording.summary())
    else:
        from graspfx.show.summary import print_summary

        print_summary([recording])
        _name_files(written)
    return _faults(recording)


def _check(chosen: Namespace) -> int:
    from graspfx.scene.load import load
    from graspfx.scene.plan import plan

    scene = load(chosen.scene, dict(chosen.overrides))
    for row in plan(scene):
        print(f"{'runs' if row.runs else 'skipped':<9}{row.step:<24}{row.why}")
    return DONE


def _list(chosen: Namespace) -> int:
    from graspfx.plugins import names

    for group in ("scenes", "devices", "dynamics"):
        found = names(group)
        width = max(map(len, found), default=0)
        print(group, *(f"  {name:<{width}}  {origin}" for name, origin in found.items()), sep="\n")
    return DONE


def _schema(chosen: Namespace) -> int:
    from graspfx.scene.model import schema

    _print_json(schema())
    return DONE


def _plot(chosen: Namespace) -> int:
    from graspfx.errors import InputError
    from graspfx.loop.record import Recording
    from graspfx.show.plot import figure
    from graspfx.show.summary import print_summary

    if len(chosen.recordings) > 2:
        raise InputError("RECORDING", len(chosen.recordings), "one or two recordings")
    recordings = [Recording.load(path) for path in chosen.recordings]
    folder: Path = chosen.out or chosen.recordings[0].parent
    folder.mkdir(parents=True, exist_ok=True)
    picture = folder / ("figure.png" if len(recordings) == 1 else "comparison.png")
    figure(recordings, picture)
    print_summary(recordings, _labels(chosen.recordings))
    _name_files([picture])
    return DONE


def _labels(paths: Sequence[Path]) -> list[str]:
    """What tells recordings apart: their folders' names if those differ, else their paths."""
    folders = [path.resolve().parent.name for path in paths]
    return folders if len(set(folders)) == len(paths) else [str(path) for path in paths]


def _faults(recording: Recording) -> int:
    for fault in recording.faults:
        print(fault, file=sys.stderr)
    return FAULTS if recording.faults else DONE


def _name_files(paths: Sequence[Path]) -> None:
    for path in paths:
        print(f"wrote {path}")


def _print_json(value: object) -> None:
    import json

    print(json.dumps(value, indent=2, allow_nan=False))


if __name__ == "__main__":
    sys.exit(main())
