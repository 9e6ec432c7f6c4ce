"""graspfx run: simulate a scene, record it and sum it up."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_scene
from graspfx.commands.output import (
    INTERRUPTED,
    doubts,
    draw,
    name_files,
    note,
    print_json,
    require_place,
    say_faults,
)

if TYPE_CHECKING:
    from graspfx.scene.model import Scene


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    parser.add_argument("--duration", metavar="S", type=float, help="seconds to simulate instead of the scene's own")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder of recording.h5 and figure.png (out/SCENE)")
    parser.add_argument("--no-figure", action="store_true", help="draw nothing")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON, and nothing else")


def execute(chosen: Namespace) -> int:
    from graspfx.commands.stopping import interruptible
    from graspfx.scene.kept import keep, kept, place
    from graspfx.scene.run import run
    from graspfx.show.remarks import remarks

    where = place(chosen.scene, dict(chosen.overrides))
    known = kept(where) if where is not None else None
    scene, notes = known or _checked(chosen)
    note(notes)
    folder: Path = chosen.out or Path("out") / Path(chosen.scene).stem
    written, picture = [folder / "recording.h5"], folder / "figure.png"
    if not chosen.no_figure:
        require_place(picture)
    with interruptible() as stop:
        recording = run(scene, duration=chosen.duration, out=folder, stop=stop)
    if not recording.outcome.complete:
        done, meant = len(recording) * scene.period, chosen.duration or scene.duration
        print(f"interrupted after {done:g} of {meant:g} s; {written[0]} holds them", file=sys.stderr)
        return INTERRUPTED
    if where is not None and known is None:
        keep(where, scene, notes)
    if not chosen.no_figure:
        draw([recording], picture, f"; the run is in {written[0]}")
        written.append(picture)
    if chosen.json:
        print_json(recording.summary())
    else:
        from graspfx.show.summary import print_summary

        print_summary([recording])
        name_files(written)
    note(remarks(recording))
    return say_faults(recording)


def _checked(chosen: Namespace) -> tuple[Scene, list[str]]:
    """The scene, and what its author may not have meant."""
    from graspfx.scene.load import load
    from graspfx.scene.making.meshes import mesh_notes

    scene = load(chosen.scene, dict(chosen.overrides))
    return scene, [*mesh_notes(scene.object, scene.source.folder), *doubts(scene)]
