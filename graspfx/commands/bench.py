"""graspfx bench: run time against error, every method beside its peers."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from graspfx.commands.destination import add_destination, require_room
from graspfx.commands.output import DONE

EXAMPLE = """  graspfx bench eq4 ticks --quick"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("names", metavar="NAME", nargs="*", help="of benchmarks (all of them)")
    parser.add_argument("--quick", action="store_true", help="a few seconds each, and rougher")
    parser.add_argument("--json", action="store_true", help="print the report as JSON, and nothing else")
    add_destination(parser, "DIR", "folder of benchmarks.json, its page and pictures, which --overwrite updates")


def execute(chosen: Namespace) -> int:
    from graspfx.bench.run import bench, files

    if chosen.out is not None:
        require_room(chosen, files(chosen.names, chosen.out))

    bench(chosen.names, quick=chosen.quick, as_json=chosen.json, out=chosen.out)
    return DONE
