"""graspfx bench: run time against error, of every method beside its peers, or of the choices of a scene."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path

from graspfx.commands.arguments import FORMATS, add_overrides, add_style
from graspfx.commands.destination import add_destination, require_room
from graspfx.commands.output import SUCCESS
from graspfx.errors import InputError, UnknownNameError

EXAMPLE = """  graspfx bench eq4 ticks --quick
  graspfx bench paper-spring --set coupling.internal.stiffness=60"""


def add_arguments(parser: ArgumentParser) -> None:
    meaning = "benchmarks (all of them), or a scene: its name, or the path of a .toml or .py file"
    parser.add_argument("names", metavar="NAME", nargs="*", help=meaning)
    add_overrides(parser)
    parser.add_argument("--duration", metavar="S", type=float, help="seconds of a scene to simulate (its own, up to 2)")
    parser.add_argument("--quick", action="store_true", help="a few seconds each, and rougher")
    parser.add_argument("--json", action="store_true", help="print the report as JSON, and nothing else")
    parser.add_argument("--redraw", action="store_true", help="measure nothing: draw the figures of --out anew")
    add_style(parser)
    parser.add_argument("--readme", metavar="FILE", type=Path, help="file whose table of speeds is written anew")
    add_destination(parser, "DIR", "folder of benchmarks.json, its page and pictures, which --overwrite updates")


def execute(options: Namespace) -> int:
    from graspfx.bench.threads import one_blas_thread

    with one_blas_thread():  # before numpy is loaded
        from graspfx.bench.suite import bench, files, redraw

        if (name := scene_among(options.names)) is not None:
            from graspfx.commands.bench_scene import bench_scene

            return bench_scene(name, options)
        if options.overrides or options.preset or options.duration is not None:
            raise InputError("--set, --preset and --duration", options.names, "the name of a scene before them")
        look = {"form": options.format or FORMATS[0], "width": options.width}
        if options.redraw and options.out is None:
            raise InputError("--redraw", "", "the folder of a report", "name it with --out")
        if options.out is not None:
            require_room(options, files(options.names, options.out, look["form"]))
        if options.redraw:
            redraw(options.names, options.out, **look)
            return SUCCESS
        bench(options.names, quick=options.quick, as_json=options.json, out=options.out, readme=options.readme, **look)
    return SUCCESS


def scene_among(names: Sequence[str]) -> str | None:
    """Pick the scene that is named; None where benchmarks are.

    A benchmark's name stays a benchmark's: a scene of that name is named by its path.

    Raises:
        InputError: a scene beside others.
        UnknownNameError: neither a benchmark nor a scene has that name.
    """
    from graspfx.bench.registry import BENCHMARKS
    from graspfx.plugins import is_file_name
    from graspfx.plugins import names as names_of

    others = [name for name in names if name not in BENCHMARKS]
    if not others:
        return None
    scenes = names_of("scenes")
    for name in others:
        if name not in scenes and not is_file_name(name):
            do = f"benchmarks are {', '.join(BENCHMARKS)}; the others are scenes"
            raise UnknownNameError("benchmark or scene", name, [*BENCHMARKS, *scenes], do)
    if len(names) > 1:
        raise InputError("NAME", " ".join(names), "benchmarks, or one scene alone")
    return others[0]
