"""python -m tests.bench [NAME ...] [--quick] [--out DIR]: measure, print, and write docs/benchmarks.md."""

from __future__ import annotations

import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, cast

from graspfx.bench.timing import one_blas_thread

if TYPE_CHECKING:
    from graspfx.bench.benchmarks import Benchmark
    from graspfx.bench.timing import Row

NAMES = ("startup", "ticks", "runs", "batches", "maps", "eq4", "projection", "contact", "bodies", "creep")
HERE = ("runs", "batches", "maps", "eq4", "projection", "contact", "bodies", "creep")  # the others are the package's


def module(name: str) -> Benchmark:
    """Import a benchmark: of the tests, or else of the package."""
    return cast("Benchmark", import_module(f"tests.bench.{name}" if name in HERE else f"graspfx.bench.{name}"))


def main(arguments: Sequence[str]) -> int:
    parser = ArgumentParser("python -m tests.bench", description=__doc__)
    parser.add_argument("names", metavar="NAME", nargs="*", choices=[*NAMES, []], help=f"{', '.join(NAMES)}; all")
    parser.add_argument("--quick", action="store_true", help="a few seconds each, and rougher")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder of benchmarks.md, which is of all benchmarks")
    options = parser.parse_args(arguments)
    if options.out is not None and options.names:
        parser.error("--out is of all benchmarks: leave out names")
    with one_blas_thread():  # before numpy is loaded
        from graspfx.bench.benchmarks import lines, measured, stamp

        modules = {name: module(name) for name in NAMES if name in options.names or not options.names}
        rows: list[Row] = []
        for name, each in modules.items():
            for case in measured(name, each, quick=options.quick):
                rows += case
                print(*lines(case), sep="\n", flush=True)
        if options.out is not None:
            from tests.bench.report import PAGE, absent, write

            write(rows, modules, stamp(quick=options.quick), options.out)
            print(f"wrote {options.out / PAGE}", *absent(rows), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
