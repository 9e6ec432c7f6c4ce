"""graspfx page: write a page that runs a scene in a browser, without installation or server."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from graspfx.commands.arguments import add_overrides, checked_scene
from graspfx.commands.destination import add_file, file_in, name_files, require_room
from graspfx.commands.output import SUCCESS
from graspfx.progress import waiting

EXAMPLE = """  graspfx page paper-waving --out waving.html
  graspfx page mug --set coupling.internal.stiffness=400 --out mug.html"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("scene", metavar="SCENE", help="name of a scene, or path of its .toml or .py file")
    add_overrides(parser)
    add_file(parser, "output file, which ends in .html (default: SCENE.html)")


def execute(options: Namespace) -> int:
    from graspfx.live.page.document import require_page_name

    path = require_page_name(file_in(options, Path(), f"{Path(options.scene).stem}.html"))
    require_room(options, [path])
    scene = checked_scene(options)
    with waiting(f"writing {path}"):
        written = scene.to_html(path, overwrite=options.overwrite)
    name_files([written])
    return SUCCESS
