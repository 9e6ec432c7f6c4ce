"""graspfx picture: draw the objects, the fingers, and the forces as arrows, at one instant of a run."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_options, add_overrides, add_style, load_scene, picture_name, recorded
from graspfx.commands.destination import add_file, destination, drawing, file_in, name_files, require_room
from graspfx.commands.output import note, say_faults, say_source
from graspfx.errors import GraspFXError, InputError
from graspfx.recording.files import recording_file

if TYPE_CHECKING:
    from graspfx.recording.header import Header
    from graspfx.recording.record import Recording


PICTURE = "picture"
EXAMPLE = """  graspfx picture pick-and-place --time 1.7 --view -60 25"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("scene", metavar="RECORDING_OR_SCENE", help="recording, its folder, or a scene to run")
    add_overrides(parser)
    add_options(
        parser,
        ("--time S", "time of the instant [s] (default: largest forces while most fingers touch)", float),
    )
    parser.add_argument(
        "--view",
        metavar="DEG",
        type=float,
        nargs=2,
        help="azimuth and elevation of the camera [deg] (default: a view that shows the fingers)",
    )
    parts = "forces to draw for each finger: internal and external (two), or total"
    parser.add_argument("--forces", choices=("two", "total"), default="two", help=parts)
    add_style(parser)
    meaning = (
        "output file, or its folder (default: picture.png beside the recording, or in out/SCENE, out/SCENE-2, ...)"
    )
    add_file(parser, meaning)


def execute(options: Namespace) -> int:
    if (source := recorded(options)) is not None:
        return _draw_recording(source, options)
    if options.out is not None:
        path = file_in(options, Path(), picture_name(PICTURE, options))
        _require_room(path, options)
        return _draw_scene(path, options)
    with destination(options, Path(options.scene).stem) as home:
        return _draw_scene(home / picture_name(PICTURE, options), options)


def _draw_recording(source: Path, options: Namespace) -> int:
    from graspfx.recording.record import Recording

    file = recording_file(source)
    path = file_in(options, file.parent, picture_name(PICTURE, options))
    _require_room(path, options)
    recording = Recording.load(file)
    say_source(source, file, recording)
    return _draw(recording, path, scene_folder(recording.header), options)


def _draw_scene(path: Path, options: Namespace) -> int:
    from graspfx.assembly.run_scene import run

    scene = load_scene(options)
    if options.time is not None and not 0.0 <= options.time <= scene.duration:
        remedy = "to extend the run, add --set duration=..."
        raise InputError(
            "--time", options.time, f"a time from 0 to {scene.duration:g} s, the duration of the scene", remedy
        )
    duration = None if options.time is None else options.time + scene.period
    return _draw(run(scene, duration=duration), path, scene.source.folder, options)


def _require_room(path: Path, options: Namespace) -> None:
    from graspfx.show.style import require_form

    require_form(options.format or path.suffix[1:].lower(), path)
    require_room(options, [path])


def _draw(recording: Recording, path: Path, meshes: Path | None, options: Namespace) -> int:
    from graspfx.show.picture.portrait import portrait

    with drawing(path) as file:
        picture = portrait(
            recording, options.time, view=options.view, folder=meshes, forces=options.forces, width=options.width
        )
        picture.save(file, options.format or "")
    note(picture.notes)
    name_files([path])
    return say_faults(recording)


def scene_folder(header: Header) -> Path | None:
    """Return the folder to which paths in the scene of a recording are relative.

    The folder is the one in the header of the recording. If this folder does not exist, it is the folder of the
    installed scene with the recorded name, or None if there is no such scene.
    """
    from graspfx.plugins import find

    folder = Path(header.scene_folder)
    if header.scene_folder and folder.is_dir():
        return folder
    try:
        return find("scenes", header.scene).parent
    except GraspFXError:
        return None
