"""The part of `graspfx view` that shows recordings: in the browser, or as a page that stands alone."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.commands.destination import require_room
from graspfx.commands.output import name_files, require_place, say_faults, say_source
from graspfx.errors import InputError
from graspfx.loop.recording.places import NAME, is_part, make_folder, recording_file
from graspfx.progress import waiting

if TYPE_CHECKING:
    from graspfx.loop.recording.record import Recording


def add_html(parser: ArgumentParser) -> None:
    """Add --html and --overwrite."""
    text = "write a recording as a page that stands alone and opens without a network, and serve nothing"
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
    if options.overrides or options.preset:
        raise InputError("--set", dict(options.overrides), "a scene to set values in", f"{options.scene} has been run")
    subject = Path(options.scene)
    file = _file_of(subject)
    if options.html is not None:
        require_place(options.html)
        require_room(options, [options.html])
    recording = _load(file)
    say_source(subject, file, recording)
    if options.html is not None:
        return _write(recording, options)
    from graspfx.live.recording_view import RecordingView

    with waiting(f"opening {file}"):
        page = RecordingView(recording, port=options.port)
    with page:
        tell(f"{page.server.url}  (this machine only; Ctrl-C ends it)")
        page.serve(stop, options.seconds)
    return say_faults(recording)


def _write(recording: Recording, options: Namespace) -> int:
    from graspfx.live.page.document import write_page

    make_folder(options.html.parent)
    with waiting(f"writing {options.html.name}"):
        write_page(recording, options.html, overwrite=True)
    name_files([options.html])
    return say_faults(recording)


def _file_of(subject: Path) -> Path:
    return recording_file(
        subject if subject.suffix == ".h5" or is_part(subject) or subject.is_dir() else subject / NAME
    )


def _load(file: Path) -> Recording:
    from graspfx.loop.recording.record import Recording

    return Recording.load(file)
