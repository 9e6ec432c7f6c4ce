"""graspfx plot: draw one recording, or several side by side."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path

from graspfx.commands.arguments import add_options, add_style, picture_name, recording
from graspfx.commands.destination import add_destination, draw, name_files, require_room
from graspfx.commands.output import SUCCESS, is_quiet, say_source
from graspfx.progress import waiting

EXAMPLE = """  graspfx plot out/conventional out/proposed --out out --format pdf --width page"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "recordings", metavar="RECORDING", nargs="+", type=recording, help="one or more recordings, or their folders"
    )
    add_options(parser, ("--brief", "show depth, squeeze and push only, in figure and table"))
    add_style(parser)
    add_destination(parser, "DIR", "folder of the figure (default: that of the first recording)")


def execute(options: Namespace) -> int:
    from graspfx.recording.files import recording_file
    from graspfx.recording.record import Recording
    from graspfx.show.summary_table import BRIEF, ROWS, print_summary

    paths = [recording_file(path) for path in options.recordings]
    folder: Path = options.out or paths[0].parent
    picture = folder / picture_name("figure" if len(paths) == 1 else "comparison", options)
    require_room(options, [picture])
    with waiting("reading recordings"):
        recordings = [Recording.load(path) for path in paths]
    for request, path, each in zip(options.recordings, paths, recordings, strict=True):
        say_source(request, path, each)
    labels = _labels(paths)
    draw(recordings, picture, brief=options.brief, width=options.width, labels=labels if len(paths) > 1 else None)
    if not is_quiet():
        print_summary(recordings, labels, BRIEF if options.brief else ROWS)
    name_files([picture])
    return SUCCESS


def _labels(paths: Sequence[Path]) -> list[str]:
    """Return a label for each recording: the name of its folder or, if two folders have the same name, its path."""
    folders = [path.resolve().parent.name for path in paths]
    return folders if len(set(folders)) == len(paths) else [str(path) for path in paths]
