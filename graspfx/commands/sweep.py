"""graspfx sweep: simulate many variants of a scene, write a file with figures, and print a table. It can be resumed."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx.commands.arguments import add_options, add_scene, add_style, load_scene, picture_name
from graspfx.commands.destination import OUT, add_destination, destination, drawing, name_files
from graspfx.commands.output import INTERRUPTED, SUCCESS, note, print_json
from graspfx.errors import InputError

if TYPE_CHECKING:
    from graspfx.sweeps.sweep_result import SweepResult

EXAMPLE = """  graspfx sweep paper-spring --over coupling.external.stiffness=20:70:25 --over object.viscosity=0.4:1.6:20
  graspfx sweep paper-spring --over object.mass=0.05:0.4 --over object.viscosity=0.4:1.6 --sample lhs:500"""
MOST = 3  # largest number of variants at each end of the table, and of reasons for failures


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    parser.add_argument(
        "--over", metavar="KEY=FROM:TO:COUNT", action="append", default=[],
        help="key and its values: evenly spaced, logarithmic with :log, or a list such as object.mass=0.1,0.2; "
        "a second key makes a grid",
    )  # fmt: skip
    add_options(
        parser,
        ("--zip", "instead of a grid, combine the first values of all keys, the second values of all keys, ..."),
        ("--sample lhs:N", "N variants from a Latin hypercube instead of a grid", str, ""),
        ("--seed N", "seed of the sample (default: 0)", int, 0),
        ("--duration SECONDS", "simulated time [s] (default: the scene's)", float),
    )
    parser.add_argument(
        "--measure", metavar="NAME", action="append", default=[],
        help="quantity, such as finger_force, or its statistic, as in finger_force.peak; the first one ranks the table",
    )  # fmt: skip
    add_options(
        parser,
        ("--executor KIND", "threads:N or processes:N (default: this process, on all processors)"),
        ("--cluster ADDRESS", "dask cluster: local:N, or a scheduler tcp://HOST:PORT"),
        ("--chunk N", "variants per chunk (default: one or two seconds of computation)", int),
        ("--resume", "continue an interrupted sweep"),
    )
    add_destination(
        parser, "DIR", "folder of chunks/, sweep.nc and sweep.png (default: out/SCENE-sweep, out/SCENE-sweep-2, ...)"
    )
    add_style(parser)
    add_options(parser, ("--json", "print all values and measures as JSON only"))


def execute(options: Namespace) -> int:
    from graspfx.progress import clear

    arguments = _arguments(options)
    scene = load_scene(options)
    with _place(options) as folder:
        from graspfx.sweeps.run_sweep import sweep

        try:
            result = sweep(scene, out=folder, **arguments)
        except KeyboardInterrupt as error:
            clear()
            done = str(error).partition(":")[0]
            print(f"interrupted: {done}; repeat the command with --out {folder} --resume to continue", file=sys.stderr)
            return INTERRUPTED
        notes = dict.fromkeys(result.notes)
        chosen = list(dict.fromkeys(_whole(result, name) for name in _measures(options)))
        files = [folder / "sweep.nc", *_draw(result, chosen or result.drawn(), folder, options, notes)]
    if options.json:
        print_json(result.to_dict())
        return SUCCESS
    print(*table(result, chosen[0] if chosen else ""), sep="\n")
    note(notes)
    name_files(files)
    return SUCCESS


def _arguments(options: Namespace) -> dict[str, Any]:
    """Return the arguments of the function `sweep`, after checks that do not load slow modules."""
    from graspfx.batch.batch import MEASURED
    from graspfx.batch.measured_columns import STATISTICS
    from graspfx.sweeps.chunk import RUN
    from graspfx.sweeps.swept_values import read_over

    if not options.over:
        raise InputError("--over", "nothing", "at least one key, as in --over object.viscosity=0.8:1.5:15")
    if options.cluster and options.executor:
        raise InputError("--cluster", options.cluster, "--cluster without --executor", "the cluster is the executor")
    values = dict(map(read_over, options.over))
    if len(values) < len(options.over):
        raise InputError("--over", ", ".join(options.over), "each key once")
    measures = [_split(name) for name in _measures(options)]
    quantities = dict.fromkeys(quantity for quantity, _ in measures)
    statistics = dict.fromkeys(statistic for quantity, statistic in measures if quantity != RUN)
    return {
        "values": values,
        "zip": options.zip,
        "sample": options.sample,
        "seed": options.seed,
        "duration": options.duration,
        "measure": list(quantities) or (RUN, *MEASURED),
        "statistics": STATISTICS if not statistics or "" in statistics else list(statistics),
        "executor": _cluster(options.cluster) if options.cluster else options.executor,
        "chunk": options.chunk,
        "resume": options.resume,
        "overwrite": options.overwrite,
    }


def _cluster(address: str) -> str:
    if address != "local" and not address.startswith("local:") and "://" not in address:
        raise InputError("--cluster", address, "local:N, or the address of a scheduler, tcp://HOST:PORT")
    return address


def _measures(options: Namespace) -> list[str]:
    """List the names given by --measure. A value of the option may contain several names, separated by commas."""
    return [name.strip() for text in options.measure for name in text.split(",") if name.strip()]


def _split(name: str) -> tuple[str, str]:
    """Split a name such as `finger_force.peak` into quantity and statistic.

    If the name has no statistic, the second item is empty, which stands for all statistics.
    """
    from graspfx.batch.measured_columns import STATISTICS
    from graspfx.sweeps.chunk import RUN, VERDICT

    quantity, _, statistic = name.rpartition(".")
    known = VERDICT if quantity == RUN else STATISTICS
    return (quantity, statistic) if quantity and statistic in known else (name, "")


@contextmanager
def _place(options: Namespace) -> Iterator[Path]:
    """Yield the folder of the sweep: --out if given; otherwise the scene's latest sweep if --resume; else a new folder.

    Raises:
        InputError: If there is no sweep to resume.
    """
    name = f"{Path(options.scene).stem}-sweep"
    if options.out is None and options.resume:
        folders = [path.parent for path in OUT.glob(f"{name}*/sweep.json")]
        if not folders:
            raise InputError("--resume", str(OUT / name), "an interrupted sweep", "give its folder with --out")
        yield max(folders, key=lambda path: path.stat().st_mtime_ns)
        return
    with destination(options, name) as folder:
        yield folder


def _draw(
    result: SweepResult, names: list[str], folder: Path, options: Namespace, notes: dict[str, None]
) -> Iterator[Path]:
    """Draw measures, yield the path of each figure, and add notes about the figures to `notes`.

    If the measures are drawn as maps, each measure has a figure of its own; otherwise one figure shows all measures.
    """
    sheets = [[name] for name in names] if result.has_maps else [names]
    for k, sheet in enumerate(sheets):
        picture = folder / picture_name("sweep" if not k else f"sweep-{sheet[0].replace('/', '-')}", options)
        with drawing(picture) as file:
            figure = result.plot(*sheet, width=options.width)
            figure.save(file, options.format or "png")
        notes.update(dict.fromkeys(figure.notes))
        yield picture


def _whole(result: SweepResult, name: str) -> str:
    quantity, statistic = _split(name)
    return f"{quantity}.{statistic}" if statistic else result.first_of(quantity)


def table(result: SweepResult, measure: str = "") -> Iterator[str]:
    """Yield lines of text: the variants with the smallest and largest values of a measure, and reasons for failures."""
    from shutil import get_terminal_size

    from graspfx.show.summary_table import ASCII, RULES, Column, lines

    name, values = result.scalar(measure)
    order = result.ranking(name).tolist()
    least, largest = order[:MOST], order[max(MOST, len(order) - MOST) :][::-1]
    keys = list(result.values)
    rows = [*(("least", k) for k in least), *(("largest", k) for k in largest)]
    yield f"{result.scene}: {len(result)} variants, {result.seconds[0]:.3g} s"
    if rows:
        flat = values.ravel()
        columns = [
            Column("", [text for text, _ in rows]),
            Column(f"{name}{_unit(result, name)}", [f"{flat[k]:.4g}" for _, k in rows], right=True),
            *(
                Column(title, [_text(result.overrides(k)[key]) for _, k in rows], folds=True)
                for key, title in zip(keys, _titles(keys), strict=True)
            ),
            Column("variant", [str(k) for _, k in rows], right=True),
        ]
        plain = not (sys.stdout.encoding or "").lower().startswith("utf")
        yield from lines(columns, get_terminal_size().columns, rules=ASCII if plain else RULES)
    faults, failures = int((result.fault_tick >= 0).sum()), int(result.failed.sum())
    if name.endswith(".growth"):
        grows = int((values > 1.0).sum())
        yield f"growing, above 1: {grows} of {len(result)}"
    if result.unstable is not None:
        yield f"NOT STABLE, as judged from the runs: {int(result.unstable.sum())} of {len(result)}"
    yield f"faults: {faults}; failures: {failures}"
    for text in result.reasons(MOST):
        yield f"  {text}"


def _unit(result: SweepResult, name: str) -> str:
    quantity, statistic = result.measure_of(name)
    unit = result.column(quantity).unit
    return "" if statistic in ("growth", "unstable") or unit == "1" else f" [{unit}]"


def _titles(keys: list[str]) -> list[str]:
    """Return titles for keys: their last two parts if these differ between all keys; otherwise the keys."""
    short = [".".join(key.split(".")[-2:]) for key in keys]
    return short if len(set(short)) == len(keys) else keys


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
