"""graspfx bench: run time against error, every method beside its peers."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from graspfx.commands.destination import add_destination, require_room
from graspfx.commands.output import SUCCESS

EXAMPLE = """  graspfx bench eq4 ticks --quick"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("names", metavar="NAME", nargs="*", help="of benchmarks (all of them)")
    parser.add_argument("--quick", action="store_true", help="a few seconds each, and rougher")
    parser.add_argument("--json", action="store_true", help="print the report as JSON, and nothing else")
    parser.add_argument("--readme", metavar="FILE", type=Path, help="file whose table of speeds is written anew")
    add_destination(parser, "DIR", "folder of benchmarks.json, its page and pictures, which --overwrite updates")


def execute(options: Namespace) -> int:
    from graspfx.bench.threads import one_blas_thread

    with one_blas_thread():  # before numpy is loaded
        from graspfx.bench.session import bench, files

        if options.out is not None:
            require_room(options, files(options.names, options.out))
        bench(options.names, quick=options.quick, as_json=options.json, out=options.out, readme=options.readme)
    return SUCCESS
