"""Run a scene: build it, tick it, keep what happened."""

from __future__ import annotations

import json
from os import PathLike
from pathlib import Path
from time import perf_counter

from graspfx.errors import InputError
from graspfx.loop.header import Header, machine, now, versions
from graspfx.loop.record import Recorder, Recording, Sink
from graspfx.scene.build import build
from graspfx.scene.model import Scene


def run(scene: Scene, duration: float | None = None, *, out: str | PathLike[str] | None = None) -> Recording:
    """Simulate a scene on its own clock (time = tick x period); two runs are bit-identical.

    Args:
        scene: from `load`, or made in Python.
        duration: instead of the scene's own [s]; rounded to whole periods.
        out: a folder in which recording.h5 is written while the run goes on, readable also if it is killed.

    Raises:
        InputError: a duration that is not a positive time, or what only shows when a device is connected.
        DeviceError: a device that cannot be opened or placed.
    """
    seconds = scene.duration if duration is None else duration
    ticks = round(seconds / scene.period) if 0.0 < seconds < float("inf") else 0
    if ticks < 1:
        raise InputError("duration", duration, f"a time of at least one period, {scene.period} s")
    with build(scene) as servo:
        header = _header(scene)
        sinks: list[Sink] = []
        if out is not None:
            from graspfx.loop.file import FileSink

            folder = Path(out)
            folder.mkdir(parents=True, exist_ok=True)
            sinks.append(FileSink(folder / "recording.h5", servo.layout, header))
        with Recorder(servo.layout, header, sinks) as recorder:
            began = perf_counter()
            servo.run(ticks, recorder)
            return recorder.finish(perf_counter() - began, fade_shortfall=servo.fade_shortfall)


def _header(scene: Scene) -> Header:
    source = scene.source
    return Header(
        period=scene.period,
        scene=source.path.stem.replace("_", "-") if source.path is not None else source.name,
        scene_text=source.text or json.dumps(scene.to_dict(), indent=1),
        scene_table=scene.to_dict(),
        overrides=dict(source.overrides),
        title=scene.title,
        created=now(),
        versions=versions("scipy", *(("pybullet",) if any(o.dynamics == "bullet" for o in scene.object) else ())),
        machine=machine(),
    )
