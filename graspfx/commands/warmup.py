"""graspfx warmup: compile the kernels of GraspFX and of scenes in advance."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_options, add_overrides, scene
from graspfx.commands.output import SUCCESS, WRONG

if TYPE_CHECKING:
    from graspfx.assembly.warm import Warmed

EXAMPLE = """  graspfx warmup"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "scenes", metavar="SCENE", nargs="*", type=scene,
        help="scenes whose drivers define kernels: names, or paths of .toml or .py files (default: none)",
    )  # fmt: skip
    add_options(parser, ("--kernels", "compile the framework's kernels only"))
    add_overrides(parser)


def execute(options: Namespace) -> int:
    from graspfx.assembly.warm import CANNOT, KERNELS, NOTHING
    from graspfx.compile.cache import folder, require_room
    from graspfx.compile.emission import require_llvm

    require_llvm()
    require_room()
    width, code = max(map(len, [KERNELS, *options.scenes])), SUCCESS
    for each in _warmed(options):
        if each.state == CANNOT:
            print(f"{each.scene:<{width}}  {each.state:<9}  {each.why}", flush=True)
            code = WRONG
        elif each.state == NOTHING:
            print(f"{each.scene:<{width}}  {each.state:<9}  to compile: it defines no kernels", flush=True)
        else:
            size = f"{1e-3 * each.size:5.0f} kB"
            print(f"{each.scene:<{width}}  {each.state:<9}  {each.seconds:5.1f} s  {size}", flush=True)
    print(f"in {folder()}")
    return code


def _warmed(options: Namespace) -> Iterator[Warmed]:
    from graspfx.assembly.warm import warm, warm_kernels

    yield warm_kernels()
    for name in [] if options.kernels else options.scenes:
        yield warm(name, dict(options.overrides), options.preset)
