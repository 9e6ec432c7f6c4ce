"""graspfx stability: how far gains can go, also over ranges of keys."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from graspfx.commands.arguments import add_scene
from graspfx.commands.certified import certify
from graspfx.commands.output import DONE, name_files, placing, print_json, require_place


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    parser.add_argument(
        "--sweep",
        metavar="KEY=FROM:TO:COUNT",
        action="append",
        default=[],
        help="a range of one key; a second one makes a map",
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder of stability.png (out/SCENE)")
    parser.add_argument("--json", action="store_true", help="print the limits as JSON, and nothing else")


def execute(chosen: Namespace) -> int:
    from graspfx.scene.limits.sweep import Sweep, limits_of_scene, swept_limits
    from graspfx.scene.load import load

    sweeps = [Sweep.read(text) for text in chosen.sweep]
    scene = load(chosen.scene, dict(chosen.overrides))
    scene.require_reach()
    if not sweeps:
        if chosen.json:
            print_json(limits_of_scene(scene).to_dict())
        else:
            certify(scene)
        return DONE
    from graspfx.loop.places import make_folder
    from graspfx.show.limits import limits_figure

    folder: Path = chosen.out or Path("out") / Path(chosen.scene).stem
    picture = folder / "stability.png"
    require_place(picture)
    limits = swept_limits(scene, sweeps)
    make_folder(folder)
    with placing(picture):
        limits_figure(limits, picture, scene.title)
    if chosen.json:
        print_json(limits.to_dict())
        return DONE
    print(*limits.lines(), sep="\n")
    name_files([picture])
    return DONE
