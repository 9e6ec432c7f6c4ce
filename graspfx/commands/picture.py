"""graspfx picture: one instant of a run drawn, with objects, fingers and forces as arrows."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_overrides, add_style, picture_name
from graspfx.commands.destination import add_file, destination, file_in, require_room
from graspfx.commands.output import name_files, note, require_place, say_faults, say_source
from graspfx.errors import GraspFXError, InputError
from graspfx.progress import waiting
from graspfx.recording.files import NAME, is_part, make_folder, placing, recording_file

if TYPE_CHECKING:
    from graspfx.recording.header import Header
    from graspfx.recording.record import Recording


PICTURE = "picture"
EXAMPLE = """  graspfx picture pick-and-place --time 1.7 --view -60 25"""


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
    parts = "internal and external force of each finger (two), or its total force"
    parser.add_argument("--forces", choices=("two", "total"), default="two", help=parts)
    add_style(parser)
    meaning = "the picture, or its folder (picture.png beside the recording, or in out/SCENE, out/SCENE-2, ...)"
    add_file(parser, meaning)


def execute(options: Namespace) -> int:
    subject = Path(options.recording)
    if subject.suffix not in (".toml", ".py"):
        folder = subject.parent != Path()  # a scene's name has no slashes
        if subject.suffix == ".h5" or is_part(subject) or recording_file(subject).is_file() or folder:
            return _draw_recording(subject, options)
    if options.out is not None:
        path = file_in(options, Path(), picture_name(PICTURE, options))
        _require_room(path, options)
        return _draw_scene(path, options)
    with destination(options, subject.stem) as home:
        return _draw_scene(home / picture_name(PICTURE, options), options)


def _draw_recording(source: Path, options: Namespace) -> int:
    from graspfx.recording.record import Recording

    if options.overrides:
        raise InputError("--set", dict(options.overrides), "a scene to set values in", f"{source} has been run")
    if options.preset:
        raise InputError("--preset", options.preset, "a scene that has it", f"{source} has been run")
    file = recording_file(source if source.suffix == ".h5" or is_part(source) or source.is_dir() else source / NAME)
    path = file_in(options, file.parent, picture_name(PICTURE, options))
    _require_room(path, options)
    recording = Recording.load(file)
    say_source(source, file, recording)
    return _draw(recording, path, scene_folder(recording.header), options)


def _draw_scene(path: Path, options: Namespace) -> int:
    from graspfx.assembly.run import run
    from graspfx.scene.load import load

    scene = load(options.recording, dict(options.overrides), preset=options.preset)
    if options.time is not None and not 0.0 <= options.time <= scene.duration:
        remedy = "--set duration=... runs it longer"
        raise InputError(
            "--time", options.time, f"a time from 0 to {scene.duration:g} s, which the scene takes", remedy
        )
    duration = None if options.time is None else options.time + scene.period
    return _draw(run(scene, duration=duration), path, scene.source.folder, options)


def _require_room(path: Path, options: Namespace) -> None:
    from graspfx.show.style import require_form

    require_form(options.format or path.suffix[1:].lower(), path)
    require_place(path)
    require_room(options, [path])


def _draw(recording: Recording, path: Path, meshes: Path | None, options: Namespace) -> int:
    from graspfx.show.picture.portrait import picture

    make_folder(path.parent)
    with waiting(f"drawing {path.name}"), placing(path) as file:
        notes = picture(
            recording,
            file,
            options.time,
            view=options.view,
            folder=meshes,
            forces=options.forces,
            width=options.width,
            form=options.format or "",
        )
    note(notes)
    name_files([path])
    return say_faults(recording)


def scene_folder(header: Header) -> Path | None:
    """Find the folder where the scene's paths start: the recorded one, or a scene of that name; None for neither."""
    from graspfx.plugins import find

    folder = Path(header.scene_folder)
    if header.scene_folder and folder.is_dir():
        return folder
    try:
        return find("scenes", header.scene).parent
    except GraspFXError:
        return None
