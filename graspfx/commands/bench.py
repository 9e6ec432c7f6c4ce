"""graspfx bench: run time against error, every method beside its peers."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from graspfx.commands.arguments import FORMATS, add_style
from graspfx.commands.destination import add_destination, require_room
from graspfx.commands.output import SUCCESS
from graspfx.errors import InputError

EXAMPLE = """  graspfx bench eq4 ticks --quick"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("names", metavar="NAME", nargs="*", help="of benchmarks (all of them)")
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
