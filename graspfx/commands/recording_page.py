"""The part of `graspfx view` that shows recordings: in the browser, or as a page that stands alone."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.commands.output import name_files, require_place, say_faults, say_source
from graspfx.commands.picture import scene_folder
from graspfx.errors import InputError
from graspfx.progress import waiting
from graspfx.recording.files import NAME, is_part, make_folder, recording_file, require_vacancy

if TYPE_CHECKING:
    from graspfx.recording.record import Recording


def add_html(parser: ArgumentParser) -> None:
    """Add --html and --overwrite."""
    text = "write a recording, or a run of a scene, as a page that stands alone and opens offline; serve nothing"
    parser.add_argument("--html", metavar="FILE", type=Path, help=text)
    parser.add_argument("--overwrite", action="store_true", help="write over a page that is there")


def is_recording(text: str) -> bool:
    """Tell whether a text names a recording, or the folder of one, rather than a scene."""
    subject = Path(text)
    if subject.suffix in (".toml", ".py"):
        return False
    return subject.suffix == ".h5" or is_part(subject) or (subject.is_dir() and _file_of(subject).is_file())


def show_recording(options: Namespace, stop: Callable[[], bool], tell: Callable[[str], object]) -> int:
    """Write a recording's page to --html, or serve one until asked to stop; give the exit code."""
    for option, value in (("--set", dict(options.overrides)), ("--preset", options.preset)):
        if value:
            raise InputError(option, value, "a scene to set values in", f"{options.scene} has been run")
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
    from graspfx.live.recording_view import RecordingView

    with waiting(f"opening {file}"):
        page = RecordingView(recording, folder=folder, port=options.port)
    with page:
        tell(f"{page.server.url}  (this machine only; Ctrl-C ends it)")
        page.serve(stop, options.seconds)
    return say_faults(recording)


def write_run(options: Namespace) -> int:
    """Run a scene for its duration, and write the run's page to --html; give the exit code."""
    from graspfx.assembly.run import run
    from graspfx.scene.load import load

    _require_room(options)
    scene = load(options.scene, dict(options.overrides), preset=options.preset)
    return _write(run(scene), scene.source.folder, options)


def _require_room(options: Namespace) -> None:
    from graspfx.live.page.document import require_page_name

    require_place(require_page_name(options.html))
    if not options.overwrite:
        require_vacancy([options.html], "choose another --html, or write over it with --overwrite")


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
