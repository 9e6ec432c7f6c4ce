"""graspfx warmup: compile kernels, and the programs of scenes, before they are needed."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from itertools import chain

from graspfx.commands.arguments import add_overrides, scene
from graspfx.commands.output import SUCCESS, WRONG

EXAMPLE = """  graspfx warmup pick-and-place knob"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "scenes", metavar="SCENE", nargs="*", type=scene, help="names, or paths of .toml or .py files (the shelf)"
    )
    parser.add_argument("--kernels", action="store_true", help="only the kernels that all scenes start with")
    add_overrides(parser)


def execute(options: Namespace) -> int:
    from graspfx.build.warm import CANNOT, KERNELS, warm_all, warm_kernels
    from graspfx.compile.cache import folder, require_room
    from graspfx.compile.emission import require_llvm
    from graspfx.plugins import names

    require_llvm()
    require_room()
    scenes = [] if options.kernels else options.scenes or list(names("scenes"))
    width, code = max(map(len, [KERNELS, *scenes])), SUCCESS
    for each in chain([warm_kernels()], warm_all(scenes, dict(options.overrides), options.preset)):
        if each.state == CANNOT:
            print(f"{each.scene:<{width}}  {each.state:<9}  {each.why}", flush=True)
            code = WRONG
        else:
            size = f"{1e-3 * each.size:5.0f} kB"
            print(f"{each.scene:<{width}}  {each.state:<9}  {each.seconds:5.1f} s  {size}", flush=True)
    print(f"in {folder()}")
    return code
