"""graspfx stability: how far gains can go, also over ranges of keys."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_scene, add_style, picture_name
from graspfx.commands.certificate import certify
from graspfx.commands.destination import add_destination, destination, require_room
from graspfx.commands.output import SUCCESS, name_files, placing, print_json, require_place

if TYPE_CHECKING:
    from graspfx.certificate.limit_sweep import Sweep
    from graspfx.scene.model import Scene


EXAMPLE = """  graspfx stability paper-spring --sweep coupling.internal.stiffness=20:200:10"""


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    parser.add_argument(
        "--sweep",
        metavar="KEY=FROM:TO:COUNT",
        action="append",
        default=[],
        help="a range of one key; a second one makes a map",
    )
    add_destination(parser, "DIR", "folder of stability.png, for a --sweep (out/SCENE, or out/SCENE-2, ...)")
    add_style(parser)
    parser.add_argument("--json", action="store_true", help="print the limits as JSON, and nothing else")


def execute(options: Namespace) -> int:
    from graspfx.certificate.limit_sweep import Sweep, limits_of_scene
    from graspfx.scene.load import load

    sweeps = [Sweep.read(text) for text in options.sweep]
    scene = load(options.scene, dict(options.overrides), preset=options.preset)
    scene.require_reach()
    if not sweeps:
        if options.json:
            print_json(limits_of_scene(scene).to_dict())
        else:
            certify(scene)
        return SUCCESS
    with destination(options, Path(options.scene).stem) as folder:
        return _draw_into(folder, scene, sweeps, options)


def _draw_into(folder: Path, scene: Scene, sweeps: list[Sweep], options: Namespace) -> int:
    from graspfx.certificate.limit_sweep import swept_limits
    from graspfx.loop.recording.places import make_folder
    from graspfx.show.limit_curves import limits_figure

    picture = folder / picture_name("stability", options)
    require_place(picture)
    require_room(options, [picture])
    limits = swept_limits(scene, sweeps)
    make_folder(folder)
    with placing(picture) as file:
        limits_figure(limits, file, scene.title, width=options.width)
    if options.json:
        print_json(limits.to_dict())
        return SUCCESS
    print(*limits.lines(), sep="\n")
    name_files([picture])
    return SUCCESS
