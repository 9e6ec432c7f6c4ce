"""graspfx bench: measure run time and error of common calls, or of the numerical options of a scene."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_options, add_overrides, add_style, picture_name
from graspfx.commands.destination import add_destination, destination, drawing, name_files, require_room
from graspfx.commands.output import SUCCESS, print_json, print_result
from graspfx.errors import InputError, UnknownNameError
from graspfx.progress import waiting

if TYPE_CHECKING:
    from graspfx.bench.timing import Row

EXAMPLE = """  graspfx bench paper-spring --set coupling.internal.stiffness=60
  graspfx bench eq4 ticks --quick"""
PICTURE = "bench"


def add_arguments(parser: ArgumentParser) -> None:
    meaning = "names of benchmarks (default: all), or one scene: its name, or the path of its .toml or .py file"
    parser.add_argument("names", metavar="NAME", nargs="*", help=meaning)
    add_overrides(parser)
    add_options(
        parser,
        ("--duration S", "simulated time [s] (default: the scene's, at most 2)", float),
        ("--quick", "measure each benchmark for a few seconds, less accurately"),
        ("--json", "print the results as JSON only"),
    )
    add_style(parser)
    add_destination(parser, "DIR", "folder of a scene's bench.png")


def execute(options: Namespace) -> int:
    from graspfx.bench.timing import one_blas_thread

    with one_blas_thread():  # before numpy is loaded
        name = scene_among(options.names)
        if name is not None:
            return bench_scene(name, options)
        if options.overrides or options.preset or options.duration is not None or options.out is not None:
            given = " ".join(options.names) or "no name"
            raise InputError("--set, --preset, --duration and --out", given, "the name of a scene before these options")
        return bench(options.names, options)


def scene_among(names: Sequence[str]) -> str | None:
    """Return the scene if the arguments are one scene; None if all names are benchmarks, or there are none.

    If a benchmark and a scene have the same name, the name refers to the benchmark.

    Raises:
        InputError: If a scene is given together with other names, or a benchmark is not part of the installed package.
        UnknownNameError: If a name is neither that of a benchmark nor that of a scene.
    """
    from graspfx.bench.benchmarks import BENCHMARKS, BESIDE_TESTS, CHECKOUT
    from graspfx.plugins import is_file_name
    from graspfx.plugins import names as names_of

    others = [name for name in names if name not in BENCHMARKS]
    scenes = names_of("scenes")
    for name in others:
        if name in BESIDE_TESTS:
            expected = f"{', '.join(BENCHMARKS)}, or a scene; {name} compares with other programs"
            raise InputError("NAME", name, expected, f"{CHECKOUT} {name}")
        if name not in scenes and not is_file_name(name):
            do = f"give the name or path of a scene, or one of the benchmarks {', '.join(BENCHMARKS)}"
            raise UnknownNameError("benchmark or scene", name, [*BENCHMARKS, *BESIDE_TESTS, *scenes], do)
    if others and len(names) > 1:
        raise InputError("NAME", " ".join(names), "names of benchmarks, or of one scene only")
    return others[0] if others else None


def bench(names: Sequence[str], options: Namespace) -> int:
    """Run the benchmarks with these names, or all benchmarks if there are no names, and print the results."""
    from graspfx.bench.benchmarks import BENCHMARKS, benchmark, lines, measured, to_dict

    rows: list[Row] = []
    for name in (each for each in BENCHMARKS if each in names or not names):
        with waiting(f"measuring {name}"):
            for case in measured(name, benchmark(name), quick=options.quick):
                rows += case
                if not options.json:
                    print(*lines(case), sep="\n", flush=True)
    if options.json:
        print_json(to_dict(rows, quick=options.quick))
    return SUCCESS


def bench_scene(name: str, options: Namespace) -> int:
    """Measure the numerical options of a scene, print the results, and draw bench.png (or .svg, .pdf)."""
    from graspfx.bench.scene_choices import trade_off, tradeoff_sheet
    from graspfx.scene.load import load
    from graspfx.show import style

    with waiting(f"reading {name}"):
        scene = load(name, dict(options.overrides), preset=options.preset)
        scene.require_reach()
    with destination(options, Path(name).stem) as folder:
        picture = folder / picture_name(PICTURE, options)
        require_room(options, [picture])
        tradeoff = trade_off(scene, duration=options.duration, quick=options.quick)
        print_result(tradeoff)
        if not tradeoff.best:
            return SUCCESS
        with drawing(picture) as file:
            from graspfx.show import style

            style.save(tradeoff_sheet(tradeoff, width=options.width), file, options.format or "png")
        name_files([picture])
    return SUCCESS
