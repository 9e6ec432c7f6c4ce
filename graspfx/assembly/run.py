"""Run a scene: build it, tick it, keep what happened."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from os import PathLike
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from graspfx import log, plugins
from graspfx.assembly.build import make_layout
from graspfx.assembly.late_simulations import require_prompt_simulations
from graspfx.assembly.pace import pace_of
from graspfx.assembly.resolve import Parts, resolve
from graspfx.assembly.run_header import source_name
from graspfx.compile.kernel import keep_lowerings
from graspfx.environment import to_path
from graspfx.errors import InputError
from graspfx.loop.columns import chosen_layout
from graspfx.loop.realtime.lifecycle import require_simulations
from graspfx.numeric import number
from graspfx.progress import waiting
from graspfx.recording.files import NAME, make_folder, recording_path, require_vacancy_of
from graspfx.recording.record import Recording
from graspfx.recording.recorder import Recorder, Sink
from graspfx.scene.tables.reading import Readable

if TYPE_CHECKING:
    from graspfx.scene.model import Scene


def run(
    scene: Scene | str | PathLike[str],
    overrides: Mapping[str, Any] | float | None = None,
    *,
    duration: float | None = None,
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
    stop: Callable[[], bool] | None = None,
    real_time: bool = False,
) -> Recording:
    """Run a scene: simulated on its own clock (time = tick x period), two runs bit-identical; or in real time.

    A scene with hardware runs in real time only. Its fingers are held still for a fifth of a second before it starts,
    and whatever ends it, zero force comes first, files are closed after that, and the hardware last. In the main thread
    SIGINT, SIGTERM and SIGHUP end it in this order, and are passed on when it is over.

    Args:
        scene: a name on the shelf, the path of a .toml or .py file, or a Scene.
        overrides: values by dotted key, as `load` takes them. (A bare number is taken for the duration, with a
            FutureWarning.)
        duration: instead of the scene's own [s]; rounded to whole periods.
        out: a folder in which recording.h5 is written; it may exist. While the run goes on its rows are only there, in
            recording.h5.part, which `Recording.load` reads also after the run was killed.
        overwrite: whether a recording that is there already, or the part of a run that was killed, is replaced.
        stop: asked again and again, before every tick or, where ticks run compiled, before 64 of them; the first True
            ends the run there, and what was recorded is marked as incomplete.
        real_time: whether each tick waits for its time on the wall's clock; a tick that comes too late leaves out whole
            periods. What a simulation computes is the same.

    Raises:
        InputError: a duration that is not a positive time, or more ticks than there is room for; an `out` that is no
            path, a `stop` that cannot be called; hardware without `real_time`, or with a finger inside its object.
        UnknownNameError, PluginError: of a scene that is loaded.
        SceneError: a scene with faults; a finger that starts out of its device's reach.
        DeviceError: a device that does not open, or is not at rest before the run.
        RecordingError: `out` has a recording already, another run is writing there, or it cannot be written; where
            rows were written already, the error says where they are.
    """
    if isinstance(overrides, int | float):
        if duration is not None:
            raise InputError("overrides", overrides, "values by dotted key", "the duration has been given by its name")
        note = f"a number after the scene is taken for its duration: write run(scene, duration={overrides})"
        log.warn(note, FutureWarning)
        overrides, duration = None, overrides
    if not isinstance(real_time, bool):
        raise InputError("real_time", real_time, "True for the wall's clock, or False for the scene's own")
    if stop is not None and not callable(stop):
        raise InputError("stop", stop, "a function without arguments that says whether to stop, or None")
    if out is not None:
        to_path("out", out, "the path of a folder")
    scene_ = scene if isinstance(scene, Readable) and not overrides else _loaded(scene, overrides)
    parts = resolve(scene_)
    if not real_time:
        require_simulations(parts.hardware)
    require_prompt_simulations(parts)
    log.info("scene %s; objects: %d, fingers: %d", scene_.source.name, len(scene_.object), len(scene_.finger))
    warn_of_axes(parts)
    layout = chosen_layout(make_layout(parts, real_time=real_time), scene_.record.columns)
    every = scene_.record.every
    size = 8 * layout.width / every  # bytes of a tick
    ticks = ticks_of(scene_.duration if duration is None else duration, scene_.period)
    if out is None:
        require_memory(ticks, size)
    else:
        _require_disk(recording_path(out, "out"), ticks, layout.bytes_on_disk / every)
    if out is not None and not overwrite:
        require_vacancy_of(recording_path(out, "out") / NAME)
    file = None
    with ExitStack() as stack, plugins.unchanged():
        if out is not None:
            from graspfx.recording.sink import FileSink
        pace = pace_of(stack, parts, layout, ticks, real_time=real_time)
        header = pace.header
        sinks: list[Sink] = []
        if out is not None:
            file, packed = make_folder(out) / NAME, scene_.record.compression
            sinks.append(FileSink(file, pace.layout, header, overwrite=overwrite, compression=packed))
        with Recorder(
            pace.layout, header, sinks, keep=out is None, ticks=ticks, real_time=real_time
        ) as recorder:  # fmt: skip
            began = perf_counter()
            with waiting(f"running {source_name(scene_.source)}", ticks, "ticks", lambda: pace.ticks):
                pace.run(ticks, recorder, stop)
            took, complete = perf_counter() - began, pace.ticks == ticks
            keep_lowerings()  # of kernels that were called
            recording = recorder.finish(took if complete else None, complete=complete, **pace.outcome)
    finished = recording if file is None else Recording.load(file)
    if file is not None:
        log.info("wrote %s", file)
    how = finished.outcome
    log.info("%d ticks in %.3g s, %s; faults: %d", finished.ticks, took, how.engine, len(how.faults))
    finished._beside = plugins.upward("Recording.beside")(scene_)
    return finished


def _loaded(scene: Scene | str | PathLike[str], overrides: Mapping[str, Any] | None) -> Scene:
    from graspfx.scene.load import to_scene  # loads what checks a scene, which one from the cache does without

    return to_scene(scene, overrides)


def warn_of_axes(parts: Parts) -> None:
    """Warn of gains that are matrices in axes in which they create energy on a turning object."""
    scene = parts.scene
    if scene.coupling.axes == "object" and scene.coupling.reaction == "fingertip":
        return
    from graspfx.assembly.axes import axes_notes
    from graspfx.grasp.impedance import ActiveCouplingWarning

    for text in axes_notes(parts):
        log.warn(text, ActiveCouplingWarning)


def ticks_of(duration: float, period: float) -> int:
    """Count the whole periods in a time.

    Raises:
        InputError: a time that is none, or shorter than a period.
    """
    expected = f"a time of at least one period, {period} s"
    ratio = number("duration", duration, expected) / period
    if ratio <= 0.5:
        raise InputError("duration", duration, expected)
    return round(ratio)


def require_memory(ticks: float, size: float) -> None:
    """Raise InputError where so many ticks of so many bytes have no room in memory."""
    _require_room(ticks, size, "this machine's memory", _memory())


def _require_disk(folder: Path, ticks: float, size: float) -> None:
    """Raise InputError where so many ticks of so many bytes have no room on the disk of a folder that may not exist."""
    home = next((each for each in (folder, *folder.absolute().parents) if each.is_dir()), None)
    usage = None if home is None else shutil.disk_usage(home)
    if usage is not None and usage.total > 0:  # what is no disk, as /proc, has none
        _require_room(ticks, size, f"the disk of {folder}", usage.free)


def _require_room(ticks: float, size: float, where: str, limit: float) -> None:
    if ticks * size > limit:
        raise InputError(
            "duration",
            ticks,
            f"at most {limit / size:.3g} periods: each takes {size:g} bytes to record, and {where} has room for "
            f"{limit / 1e9:.3g} GB, not {ticks * size / 1e9:.3g} GB",
            "make the duration shorter or the period longer",
        )


def _memory() -> float:
    """Count the bytes in this machine; where it does not say, those that it could address."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return float(sys.maxsize)
