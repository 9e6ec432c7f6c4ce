"""graspfx picture: one instant of a run drawn, with objects, fingers and forces as arrows."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_overrides
from graspfx.commands.output import name_files, note, placing, require_place, say_faults
from graspfx.errors import GraspFXError, InputError

if TYPE_CHECKING:
    from graspfx.loop.header import Header
    from graspfx.loop.record import Recording


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("recording", metavar="RECORDING_OR_SCENE", help="a recording, its folder, or a scene to run")
    add_overrides(parser)
    parser.add_argument("--time", metavar="S", type=float, help="of the instant (where the forces are largest)")
    parser.add_argument(
        "--view",
        metavar="DEG",
        type=float,
        nargs=2,
        help="azimuth and elevation of the viewer (where fingers are seen)",
    )
    parser.add_argument("--out", metavar="FILE", type=Path, help="the picture (picture.png beside the recording)")


def execute(chosen: Namespace) -> int:
    from graspfx.loop.places import make_folder
    from graspfx.show.portrait import picture

    recording, meshes, home = _recorded(chosen)
    path: Path = chosen.out or home / "picture.png"
    require_place(path)
    make_folder(path.parent)
    with placing(path):
        notes = picture(recording, path, chosen.time, view=chosen.view, folder=meshes)
    note(notes)
    name_files([path])
    return say_faults(recording)


def _recorded(chosen: Namespace) -> tuple[Recording, Path | None, Path]:
    """A recording, or a scene that is run for it; where paths of meshes start; and where its pictures go."""
    from graspfx.loop.places import NAME, recording_file
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
