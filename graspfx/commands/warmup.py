"""graspfx warmup: compile the programs of scenes before they are needed."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from graspfx.commands.arguments import add_overrides, scene
from graspfx.commands.output import SUCCESS, WRONG

EXAMPLE = """  graspfx warmup pick-and-place knob"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "scenes", metavar="SCENE", nargs="*", type=scene, help="names, or paths of .toml or .py files (the shelf)"
    )
    add_overrides(parser)


def execute(options: Namespace) -> int:
    from graspfx.build.warm import CANNOT, warm_all
    from graspfx.compile.cache import folder, require_room
    from graspfx.compile.native import require_llvm
    from graspfx.plugins import names

    require_llvm()
    require_room()
    scenes = options.scenes or list(names("scenes"))
    width, code = max(map(len, scenes)), SUCCESS
    for each in warm_all(scenes, dict(options.overrides), options.preset):
        if each.state == CANNOT:
            print(f"{each.scene:<{width}}  {each.state:<9}  {each.why}", flush=True)
            code = WRONG
        else:
            size = f"{1e-3 * each.size:5.0f} kB"
            print(f"{each.scene:<{width}}  {each.state:<9}  {each.seconds:5.1f} s  {size}", flush=True)
    print(f"in {folder()}")
    return code
