"""graspfx view: show and control a running scene in the browser, or show a recording."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from graspfx.commands.arguments import add_options, add_overrides, checked_scene, load_scene, recorded, seconds_of
from graspfx.commands.destination import OUT, name_files, require_room
from graspfx.commands.output import FAULTS, SUCCESS, interruptible, say_faults, say_source, tell, warn_of_hardware
from graspfx.commands.picture import scene_folder
from graspfx.progress import waiting
from graspfx.recording.files import make_folder, new_folder, recording_file

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
    add_options(
        parser,
        ("--port N", "port on 127.0.0.1 (default: the first free one from 8080)", int),
        ("--seconds S", "time after which the command ends [s]", float),
        ("--out DIR", "folder of recordings (default: out/SCENE, out/SCENE-2, ...)", Path),
        ("--html FILE", "write the recording, or a run of the scene, as a standalone page that opens offline", Path),
        ("--overwrite", "overwrite an existing page"),
    )


def execute(options: Namespace) -> int:
    from graspfx.screen.claim_server import require_websockets

    seconds_of(options)  # before anything is loaded
    if options.html is None:
        require_websockets("a page", "view")
    if (source := recorded(options)) is not None:
        with interruptible() as stop:
            return _show_recording(source, options, stop)
    if options.html is not None:
        return _write_run(options)
    from graspfx.assembly.resolve import resolve

    scene = checked_scene(options)
    parts = resolve(scene)
    if parts.hardware:
        warn_of_hardware()
    has_hands = bool(scene.hand) or not parts.hardware  # the page must not move a finger that a person holds
    return _serve(scene, "hands" if has_hands else None, options)


def _serve(scene: Scene, guide: Literal["hands"] | None, options: Namespace) -> int:
    """Run a scene and serve a page until Ctrl-C or for the time of --seconds; return the exit code.

    The page may move hands if `guide` is "hands".
    """
    from graspfx.live.live_run import LiveRun
    from graspfx.live.sliders import live_keys, sliders
    from graspfx.live.view.live_page import LivePage

    with interruptible() as stop, ExitStack() as stack:
        with waiting(f"starting {options.scene}"):
            numbers = sliders(scene)
            run = stack.enter_context(LiveRun(scene, live=live_keys(numbers), guide=guide))
            page = stack.enter_context(
                LivePage(run, numbers, lambda: _folder(options, scene), port=options.port, tell=tell)
            )
        if run.has_hardware:
            tell("HARDWARE IS ARMED: the page's gains stay within the certificate")
        tell(f"{page.server.url}  (this machine only; Ctrl-C ends it)")
        page.serve(stop, seconds_of(options))
        return FAULTS if run.fault is not None or run.cause else SUCCESS


def _folder(options: Namespace, scene: Scene) -> Path:
    """Create and return the folder of the next recording."""
    if options.out is None:
        return new_folder(OUT, Path(scene.source.name).stem)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    return new_folder(options.out.parent, options.out.name)


def _show_recording(source: Path, options: Namespace, stop: Callable[[], bool]) -> int:
    """Write a page with a recording to --html or, without --html, serve the page until Ctrl-C or for --seconds.

    Returns:
        Exit code.
    """
    file = recording_file(source)
    if options.html is not None:
        _require_room(options)
    from graspfx.recording.record import Recording

    recording = Recording.load(file)
    say_source(source, file, recording)
    folder = scene_folder(recording.header)
    if options.html is not None:
        return _write(recording, folder, options)
    from graspfx.live.view.recording_page import RecordingPage

    with RecordingPage(recording, folder=folder, port=options.port) as page:
        tell(f"{page.server.url}  (this machine only; Ctrl-C ends it)")
        page.serve(stop, seconds_of(options))
    return say_faults(recording)


def _write_run(options: Namespace) -> int:
    """Run a scene, and write a page with the recording to --html; return the exit code."""
    from graspfx.assembly.run_scene import run

    _require_room(options)
    scene = load_scene(options)
    return _write(run(scene), scene.source.folder, options)


def _require_room(options: Namespace) -> None:
    from graspfx.live.page.document import require_page_name

    require_room(options, [require_page_name(options.html)], "--html")


def _write(recording: Recording, folder: Path | None, options: Namespace) -> int:
    from graspfx.live.page.document import write_page

    make_folder(options.html.parent)
    with waiting(f"writing {options.html.name}"):
        write_page(recording, options.html, folder=folder, overwrite=options.overwrite)
    name_files([options.html])
    return say_faults(recording)
