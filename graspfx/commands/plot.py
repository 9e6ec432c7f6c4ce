"""graspfx plot: one recording drawn, or two side by side."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path

from graspfx.commands.output import DONE, draw, name_files
from graspfx.errors import InputError


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("recordings", metavar="RECORDING", nargs="+", type=Path, help="one or two, or their folders")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder of the picture (that of the first recording)")


def execute(chosen: Namespace) -> int:
    from graspfx.loop.places import make_folder, recording_file
    from graspfx.loop.record import Recording
    from graspfx.show.summary import print_summary

    if len(chosen.recordings) > 2:
        raise InputError("RECORDING", len(chosen.recordings), "one or two recordings")
    paths = [recording_file(path) for path in chosen.recordings]
    recordings = [Recording.load(path) for path in paths]
    folder = make_folder(chosen.out or paths[0].parent)
    picture = folder / ("figure.png" if len(recordings) == 1 else "comparison.png")
    draw(recordings, picture)
    print_summary(recordings, _labels(paths))
    name_files([picture])
    return DONE


def _labels(paths: Sequence[Path]) -> list[str]:
    """What tells recordings apart: their folders' names if those differ, else their paths."""
    folders = [path.resolve().parent.name for path in paths]
    return folders if len(set(folders)) == len(paths) else [str(path) for path in paths]
