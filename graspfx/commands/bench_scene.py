"""graspfx bench SCENE: run time against error over the choices of a scene, as a table, JSON and a figure."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from graspfx.commands.arguments import picture_name
from graspfx.commands.destination import destination, require_room
from graspfx.commands.output import SUCCESS, name_files, print_json, require_place
from graspfx.errors import InputError
from graspfx.loop.recording.places import make_folder, placing
from graspfx.progress import waiting

PICTURE = "bench"


def bench_scene(name: str, options: Namespace) -> int:
    """Measure the choices of a scene; print them, and draw bench.png into the folder of --out, or a new one."""
    from graspfx.bench.own_scene.tradeoff import trade_off
    from graspfx.scene.load import load

    if options.redraw or options.readme is not None:
        raise InputError("--redraw and --readme", name, "benchmarks, not a scene")
    with waiting(f"reading {name}"):
        scene = load(name, dict(options.overrides), preset=options.preset)
        scene.require_reach()
    with destination(options, Path(name).stem) as folder:
        picture = folder / picture_name(PICTURE, options)
        require_place(picture)
        require_room(options, [picture])
        tradeoff = trade_off(scene, duration=options.duration, quick=options.quick)
        if options.json:
            print_json(tradeoff.to_dict())
        else:
            print(*tradeoff.lines(), sep="\n", flush=True)
        if not tradeoff.best:
            return SUCCESS
        make_folder(folder)
        with waiting(f"drawing {picture.name}"), placing(picture) as file:
            from graspfx.bench.own_scene.tradeoff_figure import tradeoff_sheet
            from graspfx.show import style

            style.save(tradeoff_sheet(tradeoff, width=options.width), file, options.format or "png")
        if not options.json:
            name_files([picture])
    return SUCCESS
