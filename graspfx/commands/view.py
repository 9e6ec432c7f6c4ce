"""graspfx view: show and control a running scene in the browser, or show a recording."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from graspfx.commands.arguments import add_options, add_overrides
from graspfx.commands.destination import OUT
from graspfx.commands.output import (
    SUCCESS,
    WRONG,
    doubts,
    interruptible,
    name_files,
    note,
    require_place,
    say_faults,
    say_source,
    warn_of_hardware,
)  # fmt: skip
from graspfx.commands.picture import scene_folder
from graspfx.errors import InputError
from graspfx.progress import waiting
from graspfx.recording.files import NAME, is_part, make_folder, new_folder, recording_file, require_vacancy

if TYPE_CHECKING:
    from graspfx.recording.record import Recording
    from graspfx.scene.model import Scene

EXAMPLE = """  graspfx view paper-waving
  graspfx view sphere-three-fingers --set coupling.internal.stiffness=300 --port 9000
  graspfx view out/latest --html waving.html"""


def add_arguments(parser: ArgumentParser) -> None:
    text = "scene (its name, or the path of its .toml or .py file) or recording"
    parser.add_argument("scene", metavar="SCENE_OR_RECORDING", help=text)
    add_overrides(parser)
    add_page(parser)
    add_options(parser, ("--out DIR", "folder of recordings (default: out/SCENE, out/SCENE-2, ...)", Path))
    _add_html(parser)


def add_page(parser: ArgumentParser) -> None:
    """Add --port and --seconds."""
    add_options(
        parser,
        ("--port N", "port on 127.0.0.1 (default: the first free one from 8080)", int),
        ("--seconds S", "time after which the command ends [s]", float),
    )


def execute(options: Namespace) -> int:
    from graspfx.screen.claim_server import require_websockets

    if options.seconds is not None and not options.seconds > 0.0:
        raise InputError("--seconds", options.seconds, "a time above zero")
    if options.html is None:
        require_websockets("a page", "view")
    if _is_recording(options.scene):
        with interruptible() as stop:
            return _show_recording(options, stop, _tell)
    if options.html is not None:
        return _write_run(options)
    from graspfx.assembly.resolve import resolve
    from graspfx.scene.load import load

    with waiting(f"checking {options.scene}"):
        scene = load(options.scene, dict(options.overrides), preset=options.preset)
        parts = resolve(scene)
        notes = doubts(scene)
    note(notes)
    if parts.hardware:
        warn_of_hardware()
    has_hands = bool(scene.hand) or not parts.hardware  # the page must not move a finger that a person holds
    return _serve(scene, "hands" if has_hands else None, options)


def _serve(scene: Scene, guide: Literal["hands"] | None, options: Namespace) -> int:
    """Run a scene and serve its page until Ctrl-C."""
    from graspfx.live.live_run import LiveRun
    from graspfx.live.sliders import live_keys, sliders
    from graspfx.live.view.live_page import LivePage

    with interruptible() as stop, ExitStack() as stack:
        with waiting(f"starting {options.scene}"):
            numbers = sliders(scene)
            run = stack.enter_context(LiveRun(scene, live=live_keys(numbers), guide=guide))
            page = stack.enter_context(
                LivePage(run, numbers, lambda: _folder(options, scene), port=options.port, tell=_tell)
            )
        if run.has_hardware:
            _tell("HARDWARE IS ARMED: the page's gains stay within the certificate")
        _tell(f"{page.server.url}  (this machine only; Ctrl-C ends it)")
        page.serve(stop, options.seconds)
        return WRONG if run.fault is not None or run.cause else SUCCESS


def _folder(options: Namespace, scene: Scene) -> Path:
    """Make the folder of the next recording."""
    if options.out is None:
        return new_folder(OUT, Path(scene.source.name).stem)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    return new_folder(options.out.parent, options.out.name)


def _tell(text: str) -> None:
    print(text)
    sys.stdout.flush()


def _add_html(parser: ArgumentParser) -> None:
    """Add --html and --overwrite."""
    add_options(
        parser,
        (
            "--html FILE",
            "write the recording, or a run of the scene, as a standalone page that opens offline",
            Path,
        ),
        ("--overwrite", "overwrite an existing page"),
    )


def _is_recording(text: str) -> bool:
    """Tell whether a text is the path of a recording or of its folder."""
    subject = Path(text)
    if subject.suffix in (".toml", ".py"):
        return False
    return subject.suffix == ".h5" or is_part(subject) or (subject.is_dir() and _file_of(subject).is_file())


def _show_recording(options: Namespace, stop: Callable[[], bool], tell: Callable[[str], object]) -> int:
    """Write the page of a recording to --html, or serve it until Ctrl-C; return the exit code."""
    for option, value in (("--set", dict(options.overrides)), ("--preset", options.preset)):
        if value:
            raise InputError(option, value, "a scene instead of a recording", f"{options.scene} is a recording")
    subject = Path(options.scene)
    file = _file_of(subject)
    if options.html is not None:
        _require_room(options)
    from graspfx.recording.record import Recording

    recording = Recording.load(file)
    say_source(subject, file, recording)
    folder = scene_folder(recording.header)
    if options.html is not None:
        return _write(recording, folder, options)
    from graspfx.live.view.recording_page import RecordingPage

    with RecordingPage(recording, folder=folder, port=options.port) as page:
        tell(f"{page.server.url}  (this machine only; Ctrl-C ends it)")
        page.serve(stop, options.seconds)
    return say_faults(recording)


def _write_run(options: Namespace) -> int:
    """Run a scene for its duration, and write the page of the run to --html; return the exit code."""
    from graspfx.assembly.run_scene import run
    from graspfx.scene.load import load

    _require_room(options)
    scene = load(options.scene, dict(options.overrides), preset=options.preset)
    return _write(run(scene), scene.source.folder, options)


def _require_room(options: Namespace) -> None:
    from graspfx.live.page.document import require_page_name

    require_place(require_page_name(options.html))
    if not options.overwrite:
        require_vacancy([options.html], "choose another --html, or overwrite it with --overwrite")


def _write(recording: Recording, folder: Path | None, options: Namespace) -> int:
    from graspfx.live.page.document import write_page

    make_folder(options.html.parent)
    with waiting(f"writing {options.html.name}"):
        write_page(recording, options.html, folder=folder, overwrite=options.overwrite)
    name_files([options.html])
    return say_faults(recording)


def _file_of(subject: Path) -> Path:
    return recording_file(
        subject if subject.suffix == ".h5" or is_part(subject) or subject.is_dir() else subject / NAME
    )
