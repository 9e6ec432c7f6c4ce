"""The graspfx command: run, check, stability, list, schema, plot and picture."""

from __future__ import annotations

import os
import sys
import warnings
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx import __version__
from graspfx.errors import GraspFXError, InputError, RecordingError

if TYPE_CHECKING:
    from graspfx.loop.header import Header
    from graspfx.loop.record import Recording
    from graspfx.scene.model import Scene

DONE, WRONG, FAULTS, INTERRUPTED = 0, 2, 3, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; the exit code is 0, 2 for an error, 3 for a run with faults, 130 when interrupted."""
    chosen = parser().parse_args(arguments)
    try:
        with _plain_warnings():
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
    top.add_argument("--version", action="version", version=f"graspfx {__version__}")
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

    stability = commands.add_parser("stability", help="say how far gains can go, also over ranges of keys")
    stability.set_defaults(command=_stability)
    _add_scene(stability)
    stability.add_argument(
        "--sweep",
        metavar="KEY=FROM:TO:COUNT",
        action="append",
        default=[],
        help="a range of one key; a second one makes a map",
    )
    stability.add_argument("--out", metavar="DIR", type=Path, help="folder of stability.png (out/SCENE)")
    stability.add_argument("--json", action="store_true", help="print the limits as JSON, and nothing else")

    listing = commands.add_parser("list", help="name the scenes, devices, hands and dynamics there are")
    listing.set_defaults(command=_list)

    schema = commands.add_parser("schema", help="print the JSON schema of a scene")
    schema.set_defaults(command=_schema)

    plot = commands.add_parser("plot", help="draw one recording, or two side by side")
    plot.set_defaults(command=_plot)
    plot.add_argument("recordings", metavar="RECORDING", nargs="+", type=Path, help="one or two, or their folders")
    plot.add_argument("--out", metavar="DIR", type=Path, help="folder of the picture (that of the first recording)")

    picture = commands.add_parser("picture", help="draw one instant: objects, fingers, forces as arrows")
    picture.set_defaults(command=_picture)
    picture.add_argument("recording", metavar="RECORDING_OR_SCENE", help="a recording, its folder, or a scene to run")
    _add_overrides(picture)
    picture.add_argument("--time", metavar="S", type=float, help="of the instant (where the forces are largest)")
    picture.add_argument(
        "--view",
        metavar="DEG",
        type=float,
        nargs=2,
        help="azimuth and elevation of the viewer (where fingers are seen)",
    )
    picture.add_argument("--out", metavar="FILE", type=Path, help="the picture (picture.png beside the recording)")
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
    _add_overrides(command)


def _add_overrides(command: ArgumentParser) -> None:
    values = command.add_argument("--set", metavar="KEY=VALUE", type=override, action="extend", nargs="+", default=[])
    values.dest, values.help = "overrides", "replace values of the scene, by dotted keys"


def _run(chosen: Namespace) -> int:
    from graspfx.scene.load import load
    from graspfx.scene.making.meshes import mesh_notes
    from graspfx.scene.run import run
    from graspfx.show.remarks import remarks

    scene = load(chosen.scene, dict(chosen.overrides))
    _note(mesh_notes(scene.object, scene.source.folder))
    _note(_doubts(scene))
    folder: Path = chosen.out or Path("out") / Path(chosen.scene).stem
    written, picture = [folder / "recording.h5"], folder / "figure.png"
    if not chosen.no_figure:
        _require_place(picture)
    with _interruptible() as stop:
        recording = run(scene, duration=chosen.duration, out=folder, stop=stop)
    if not recording.outcome.complete:
        done, meant = len(recording) * scene.period, chosen.duration or scene.duration
        print(f"interrupted after {done:g} of {meant:g} s; {written[0]} holds them", file=sys.stderr)
        return INTERRUPTED
    if not chosen.no_figure:
        _draw([recording], picture, f"; the run is in {written[0]}")
        written.append(picture)
    if chosen.json:
        _print_json(recording.summary())
    else:
        from graspfx.show.summary import print_summary

        print_summary([recording])
        _name_files(written)
    _note(remarks(recording))
    return _faults(recording)


def _check(chosen: Namespace) -> int:
    from graspfx.scene.load import load
    from graspfx.scene.plan import plan

    scene = load(chosen.scene, dict(chosen.overrides))
    scene.require_reach()
    for row in plan(scene):
        print(f"{'runs' if row.runs else 'skipped':<9}{row.step:<24}{row.why}")
    _certify(scene)
    sys.stdout.flush()
    _note(_doubts(scene))
    return DONE


def _certify(scene: Scene) -> None:
    from graspfx.scene.limits.certificate import certificates, lines

    try:
        found = certificates(scene)
    except GraspFXError as error:
        print(f"stability is not judged: {' '.join(str(error).split())}")
        return
    for certificate in found:
        print(*lines(certificate), sep="\n")


def _stability(chosen: Namespace) -> int:
    from graspfx.scene.limits.sweep import Sweep, limits_of_scene, swept_limits
    from graspfx.scene.load import load

    sweeps = [Sweep.read(text) for text in chosen.sweep]
    scene = load(chosen.scene, dict(chosen.overrides))
    scene.require_reach()
    if not sweeps:
        if chosen.json:
            _print_json(limits_of_scene(scene).to_dict())
        else:
            _certify(scene)
        return DONE
    from graspfx.loop.file import make_folder
    from graspfx.show.limits import limits_figure

    folder: Path = chosen.out or Path("out") / Path(chosen.scene).stem
    picture = folder / "stability.png"
    _require_place(picture)
    limits = swept_limits(scene, sweeps)
    make_folder(folder)
    with _placing(picture):
        limits_figure(limits, picture, scene.title)
    if chosen.json:
        _print_json(limits.to_dict())
        return DONE
    print(*limits.lines(), sep="\n")
    _name_files([picture])
    return DONE


def _list(chosen: Namespace) -> int:
    from graspfx.plugins import names

    for group in ("scenes", "devices", "hands", "dynamics"):
        if found := names(group):
            width = max(map(len, found))
            print(group, *(f"  {name:<{width}}  {origin}" for name, origin in found.items()), sep="\n")
    return DONE


def _schema(chosen: Namespace) -> int:
    from graspfx.scene.model import schema

    _print_json(schema())
    return DONE


def _plot(chosen: Namespace) -> int:
    from graspfx.loop.file import make_folder, recording_file
    from graspfx.loop.record import Recording
    from graspfx.show.summary import print_summary

    if len(chosen.recordings) > 2:
        raise InputError("RECORDING", len(chosen.recordings), "one or two recordings")
    paths = [recording_file(path) for path in chosen.recordings]
    recordings = [Recording.load(path) for path in paths]
    folder = make_folder(chosen.out or paths[0].parent)
    picture = folder / ("figure.png" if len(recordings) == 1 else "comparison.png")
    _draw(recordings, picture)
    print_summary(recordings, _labels(paths))
    _name_files([picture])
    return DONE


def _picture(chosen: Namespace) -> int:
    from graspfx.loop.file import make_folder
    from graspfx.show.portrait import picture

    recording, meshes, home = _recorded(chosen)
    path: Path = chosen.out or home / "picture.png"
    _require_place(path)
    make_folder(path.parent)
    with _placing(path):
        notes = picture(recording, path, chosen.time, view=chosen.view, folder=meshes)
    _note(notes)
    _name_files([path])
    return _faults(recording)


def _recorded(chosen: Namespace) -> tuple[Recording, Path | None, Path]:
    """A recording, or a scene that is run for it; where paths of meshes start; and where its pictures go."""
    from graspfx.loop.file import NAME, recording_file
    from graspfx.loop.record import Recording

    given = Path(chosen.recording)
    folder = given.parent != Path() and given.suffix not in (".toml", ".py")  # a scene's name has no slashes
    if given.suffix == ".h5" or (given / NAME).is_file() or folder:
        if chosen.overrides:
            raise InputError("--set", dict(chosen.overrides), "a scene to set values in", f"{given} has been run")
        file = recording_file(given) if given.suffix == ".h5" else given / NAME
        recording = Recording.load(file)
        return recording, _folder_of(recording.header), file.parent

    from graspfx.scene.load import load
    from graspfx.scene.run import run

    scene = load(chosen.recording, dict(chosen.overrides))
    duration = None if chosen.time is None else max(chosen.time, 0.0) + scene.period
    return run(scene, duration=duration), scene.source.folder, Path("out") / given.stem


def _folder_of(header: Header) -> Path | None:
    """Where the scene's paths start, or where a scene of that name is now; None for what is nowhere."""
    from graspfx.plugins import find

    folder = Path(header.scene_folder)
    if header.scene_folder and folder.is_dir():
        return folder
    try:
        return find("scenes", header.scene).parent
    except GraspFXError:
        return None


def _draw(recordings: Sequence[Recording], picture: Path, otherwise: str = "") -> None:
    from graspfx.show.plot import figure

    _require_place(picture)
    with _placing(picture, otherwise):
        figure(recordings, picture)


@contextmanager
def _placing(picture: Path, otherwise: str = "") -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RecordingError(f"{picture}: cannot be written; {error.strerror}{otherwise}") from error


def _require_place(picture: Path) -> None:
    """No folder may stand where the picture goes: to be known before the run."""
    if picture.is_dir():
        raise RecordingError(f"{picture}: is a folder, where the picture is to go; choose another --out")


@contextmanager
def _interruptible() -> Iterator[Callable[[], bool]]:
    """Asks whether to stop, which Ctrl-C says; a second one ends the process at once.

    An exception that the signal raises can be lost inside a library's callback; a flag cannot.
    """
    import signal
    import threading

    def ask(number: int, frame: object) -> None:
        asked.append(number)
        signal.signal(number, signal.SIG_DFL)

    asked: list[int] = []
    before = signal.getsignal(signal.SIGINT)
    ours = before is signal.default_int_handler and threading.current_thread() is threading.main_thread()
    if not ours:  # ignored, as in the background, or somebody else's
        yield lambda: False
        return
    signal.signal(signal.SIGINT, ask)
    try:
        yield lambda: bool(asked)
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """A warning is one line, said once."""
    said: set[str] = set()

    def show(message: Warning | str, *_: object, **__: object) -> None:
        text = " ".join(str(message).split())
        if text not in said:
            said.add(text)
            print(f"warning: {text}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


def _labels(paths: Sequence[Path]) -> list[str]:
    """What tells recordings apart: their folders' names if those differ, else their paths."""
    folders = [path.resolve().parent.name for path in paths]
    return folders if len(set(folders)) == len(paths) else [str(path) for path in paths]


def _doubts(scene: Scene) -> list[str]:
    """What is no fault of a scene and yet may not be meant."""
    from graspfx.scene.settling import unsettled
    from graspfx.scene.units import unit_notes

    return [*unit_notes(scene), *unsettled(scene)]


def _note(notes: Iterable[str]) -> None:
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


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
