"""Simulation of many variants of a scene in chunks: `sweep`."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx import __version__, log, plugins
from graspfx.assembly.build import build
from graspfx.assembly.provenance import engine_versions, files_of, source_name
from graspfx.assembly.resolve import require_prompt_simulations, resolve
from graspfx.assembly.run_scene import ticks_of
from graspfx.assembly.session import warn_of_axes
from graspfx.batch.batch import MEASURED, names_of, require_known
from graspfx.batch.measured_columns import STATISTICS, Statistics
from graspfx.environment import is_granted
from graspfx.errors import InputError, SceneError
from graspfx.loop.columns import Layout
from graspfx.loop.servo import foreign, guests, looked_ahead
from graspfx.numeric import count
from graspfx.progress import waiting
from graspfx.recording.header import now
from graspfx.sweeps.chunk import RUN, Chunk, ChunkResult, SceneOrder, SweepError, column_of, forget
from graspfx.sweeps.crew import ChunkLoop, Crew, crew_of
from graspfx.sweeps.sweep_folder import SweepFolder, folder_of, identity_of, open_folder, sweep_parts
from graspfx.sweeps.sweep_result import SweepResult
from graspfx.sweeps.swept_values import VariantGrid, make_grid, scattered

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

TICKS = 2_000_000  # largest number of ticks in a chunk of native variants, which take a second or two
ALONE = 100_000  # largest number of ticks in a chunk whose variants run one by one
MOST_LOOKS = 64  # largest number of variants to try until one is valid
LEAST_SHARE = 4  # chunks per worker in a long sweep


class SweepWarning(UserWarning):
    """Warning of a sweep about a damaged chunk, a process that died, or the removal of another sweep."""


def sweep(
    scene: Scene | str | PathLike[str],
    values: Mapping[str, Any],
    *,
    out: str | PathLike[str] | None = None,
    executor: Any = None,
    resume: bool = True,
    overwrite: bool = False,
    duration: float | None = None,
    zip: bool = False,
    measure: Sequence[str] = (RUN, *MEASURED),
    statistics: Sequence[str] = STATISTICS,
    sample: str = "",
    seed: int = 0,
    chunk: int | None = None,
) -> SweepResult:
    """Simulate many variants of a scene in chunks, and save each chunk when it is complete.

    Results are bitwise identical to those of `run_batch`, except that they do not contain -0.0. They do not depend on
    the size of the chunks or on the executor. A variant whose parts are not all kernels runs separately, and its
    measures are computed by the same code. If a variant has a fault, `fault_tick` is the tick of the fault. If a
    variant is not a valid scene or kills its process, `failure` is the reason, and its measures are NaN.

    If `out` is a folder, each chunk is written to a file atomically. To resume a sweep that was killed, call `sweep`
    again with the same arguments; the executor may differ. When all chunks are complete, the file `sweep.nc` is
    written. It is a netCDF 4 file with names, units and coordinates, which xarray can open.

    Args:
        scene: Scene with simulated devices only, or its name or path.
        values: Values of each key, by dotted key as for `scene.replace`: a list, an array, or a range such as
            "20:70:25" (25 values from 20 to 70) or "1:1000:4:log" (4 values with equal ratios). All combinations are
            run; the last key changes fastest.
        out: Folder of the results; None to keep the results in memory only.
        executor: None for this process with all processors; "threads:N" or "processes:N" for N threads or processes;
            "local:N" for a dask cluster on this machine; "tcp://HOST:PORT" for the scheduler of a dask cluster; an
            executor of `concurrent.futures`; or a dask client. A script that uses processes must call `sweep` below
            `if __name__ == "__main__":`.
        resume: Whether to resume the sweep if `out` contains the same sweep.
        overwrite: Whether to remove any sweep in `out` first; a warning describes the removed sweep.
        duration: Duration of each run [s], rounded to whole periods; by default the scene's duration.
        zip: Whether to combine the first values of all keys, then the second values, and so on, instead of all
            combinations.
        measure, statistics: Quantities and statistics, as for `run_batch`. The quantity "run" has its own statistics:
            `vibration`, the RMS over fingers and ticks of the force above 5 Hz [N], and `unstable`, which is 1 if an
            oscillation grows by the criterion of `Recording.summary`, and otherwise 0. The quantity "run" takes some
            milliseconds per variant, because it requires a recording.
        sample: "lhs:N" for N variants of a Latin hypercube. Ranges are sampled continuously; each value of a list
            occurs equally often.
        seed: Seed of the sample; it is stored with the results.
        chunk: Number of variants per chunk; by default a number that takes one or two seconds. A resumed sweep keeps
            its initial number.

    Raises:
        SweepError: If `out` contains another sweep; `out` contains the same sweep and `resume` is False; another
            process is running a sweep in `out`; or workers do not start, or have other files or versions.
        SceneError: If no examined variant is a valid scene.
        InputError: If values are invalid, the scene has hardware, or the executor is unknown.
        UnknownNameError: If a quantity or statistic does not exist.
        MissingPackageError: If a package that the scene or the cluster requires is not installed.
        RecordingError: If the folder cannot be written.
        KeyboardInterrupt: If the sweep is interrupted; the message reports the progress and how to resume the sweep.
    """
    from graspfx.scene.load import to_scene

    began = perf_counter()
    scene_ = to_scene(scene)
    measure, statistics = names_of("measure", measure), names_of("statistics", statistics)
    if not measure or not statistics:
        raise InputError("statistics" if measure else "measure", [], "at least one name")
    require_known("statistic", statistics, STATISTICS)
    if chunk is not None:
        chunk = count("chunk", chunk, 1)
    folder = None if out is None else folder_of(out)
    variants = make_grid(values, zip=zip, sample=sample, seed=seed)
    with plugins.unchanged(), waiting(f"looking at {source_name(scene_.source)}"):
        prospect = look_at(scene_, variants, duration, measure)
        files, engines = files_of(scene_, variants.lists), engine_versions(scene_, variants.lists)
    seconds = float(scene_.duration if duration is None else duration)
    parts = sweep_parts(scene_, variants, seconds, list(prospect.shapes), statistics, files, engines)
    order = SceneOrder(
        scene_.to_dict(), scene_.source, is_granted(), duration, prospect.shapes, tuple(statistics), prospect.native,
        files, engines, (socket.gethostname(), os.getpid()),
    )  # fmt: skip
    with crew_of(executor) as crew:
        size = chunk or _size(len(variants), prospect, crew)
        opened = (
            nullcontext() if folder is None else open_folder(folder, parts, size, resume=resume, overwrite=overwrite)
        )
        with opened as store:
            if store is not None and store.removal:
                log.warn(store.removal, SweepWarning)
            work = Work(scene_, variants, order, prospect, size if store is None else store.size, store)
            work.recall()
            work.do(crew)
            return work.result(parts, perf_counter() - began)


def _size(count: int, prospect: Prospect, crew: Crew) -> int:
    """Choose the number of variants per chunk.

    A chunk has enough variants that the set-up time is small, and few enough that all workers have chunks to run.
    """
    suits = (TICKS if prospect.native else ALONE) // prospect.ticks
    share = -(-count // (LEAST_SHARE * crew.workers))
    return max(1, min(suits, max(share, suits // LEAST_SHARE)))


class Prospect(NamedTuple):
    """Properties of a sweep, obtained from one valid variant.

    Attributes:
        layout: Columns of a recording of the variant.
        shapes: Shape of each measured quantity, by the quantity's name.
        native: Whether all parts of the variant are kernels.
        ticks: Number of ticks of a run.
    """

    layout: Layout
    shapes: dict[str, tuple[int, ...]]
    native: bool
    ticks: int


def look_at(scene: Scene, variants: VariantGrid, duration: float | None, measure: Sequence[str]) -> Prospect:
    """Determine properties of a sweep from the first valid variant among up to 64 variants spread over the sweep.

    Raises:
        SceneError: If none of these variants is a valid scene; the error is that of the first variant.
        InputError: If the scene has hardware, or the duration is invalid.
        UnknownNameError: If a quantity does not exist.
        MissingPackageError: If a required package is missing.
    """
    first: SceneError | None = None
    for number in spread(len(variants)):
        overrides = variants.overrides(number)
        try:
            variant = scene.replace(overrides)
            variant.require_reach()
        except SceneError as error:
            first = first or error
            continue
        return _prospect(variant, duration, measure)
    assert first is not None
    raise first


def _prospect(scene: Scene, duration: float | None, measure: Sequence[str]) -> Prospect:
    parts = resolve(scene)
    if parts.hardware:
        names = ", ".join(parts.hardware)
        raise InputError("scene", names, "simulated devices", "a sweep cannot run hardware")
    require_prompt_simulations(parts)
    warn_of_axes(parts)
    ticks = ticks_of(scene.duration if duration is None else duration, scene.period)
    with build(scene) as servo:
        layout = servo.layout
        shapes = {name: column_of(layout, name).shape for name in measure}
        native = not any((*foreign(servo), *guests(servo), *looked_ahead(servo)))
    return Prospect(layout, shapes, native, ticks)


def spread(count: int) -> Iterator[int]:
    """Yield up to `MOST_LOOKS` indices below `count`: the first, the last, and then midpoints of intervals."""
    seen: set[int] = set()
    shares = (0.0, 1.0, *((2 * k + 1) / 2**level for level in range(1, 8) for k in range(2 ** (level - 1))))
    for share in shares:
        number = round(share * (count - 1))
        if number not in seen and len(seen) < MOST_LOOKS:
            seen.add(number)
            yield number


@dataclass
class Work:
    """State of a sweep: complete and missing chunks.

    Args:
        scene, variants: Scene and variants of the sweep.
        order: Specification of the sweep for the workers.
        prospect: Properties of the sweep.
        size: Number of variants per chunk.
        store: Folder of the chunks; None to keep results in memory only.
    """

    scene: Scene
    variants: VariantGrid
    order: SceneOrder
    prospect: Prospect
    size: int
    store: SweepFolder | None
    total: ChunkResult = field(init=False)
    members: list[NDArray[np.intp]] = field(init=False)
    missing: list[int] = field(default_factory=list)
    resumed: int = 0
    done: int = 0

    def __post_init__(self) -> None:
        self.total = self._blank(len(self.variants))
        self.members = scattered(len(self.variants), self.size)

    def _blank(self, size: int) -> ChunkResult:
        return ChunkResult.blank(size, self.order.shapes, self.order.statistics)

    def recall(self) -> None:
        """Read the complete chunks from the folder, and warn of damaged chunks."""
        for number, place in enumerate(self.members):
            result = self.store.load(number, self._blank(len(place))) if self.store is not None else None
            if result is None:
                self.missing.append(number)
            else:
                self.total.include(place, result)
                self.resumed += len(result)
        if self.store is not None and self.store.damaged:
            names = ", ".join(path.name for path in self.store.damaged[:5])
            more = f" and {len(self.store.damaged) - 5} more" if len(self.store.damaged) > 5 else ""
            text = f"{self.store.damaged[0].parent}: damaged chunks, which are computed again: {names}{more}"
            log.warn(text, SweepWarning)

    def do(self, crew: Crew) -> None:
        """Compute the missing chunks.

        Raises:
            KeyboardInterrupt: If the sweep is interrupted; the message reports the progress and how to resume it.
        """
        left = len(self.variants) - self.resumed
        if not left:
            return
        text = f"sweeping {source_name(self.scene.source)}"
        text += f" ({self.resumed} variants were complete)" if self.resumed else ""
        with self._farewell(), waiting(text, left, "variants", lambda: self.done):
            try:
                ChunkLoop(crew, self.order, self._finish, self._note).run(map(self._chunk, self.missing))
            finally:
                forget()

    def _chunk(self, number: int) -> Chunk:
        members = self.members[number]
        return Chunk(number, members, *self.variants.part(members))

    def _finish(self, chunk: Chunk, result: ChunkResult) -> None:
        if self.store is not None:
            self.store.save(chunk.number, result, self._dimensions)
        self.total.include(chunk.members, result)
        self.done += len(result)

    @cached_property
    def _dimensions(self) -> dict[str, tuple[str, ...]]:
        """Names of the axes of each array of a chunk, except the axis of variants, by the name of the array."""
        columns = {name: column_of(self.prospect.layout, name) for name in self.order.shapes}
        named = [column.dimensions for name, column in columns.items() for _ in self.total.measures[name]]
        return dict(zip(self.total.arrays, [(), *named], strict=True))

    @staticmethod
    def _note(text: str) -> None:
        log.warn(text, SweepWarning)

    @contextmanager
    def _farewell(self) -> Iterator[None]:
        """If the sweep is interrupted, add its progress and how to resume it to the message."""
        try:
            yield
        except KeyboardInterrupt:
            done, where = self.resumed + self.done, "" if self.store is None else f" in {self.store.path}"
            text = f"{done} of {len(self.variants)} variants are done{where}"
            how = "repeat the call to resume the sweep" if self.store else "the results are lost, because `out` is None"
            raise KeyboardInterrupt(f"{text}: {how}") from None

    def result(self, parts: Mapping[str, Any], took: float) -> SweepResult:
        """Return the result of the sweep, and write it to `sweep.nc` if the sweep has a folder.

        Args:
            parts: Everything on which the results depend, from `sweep_parts`.
            took: Duration of the call of `sweep` [s].

        Raises:
            RecordingError: If the file cannot be written.
        """
        shape, total = self.variants.shape, self.total
        result = SweepResult(
            values=self.variants.arrays,
            fault_tick=total.faults.reshape(shape),
            measures={
                quantity: Statistics({name: each.reshape(*shape, *each.shape[1:]) for name, each in by_name.items()})
                for quantity, by_name in total.measures.items()
            },
            notes=total.notes,
            build_time=0.0,
            run_time=total.seconds,
            scene=source_name(self.scene.source),
            layout=self.prospect.layout,
            failure=np.array(total.failures, dtype=object).reshape(shape),
            folder=None if self.store is None else self.store.path,
            about=self._about(parts),
            resumed=self.resumed,
            seconds=(took, total.seconds),
            base=self.scene,
        )
        if self.store is not None and (self.done or not self.store.is_finished):
            with waiting(f"writing {self.store.final.name}"):
                self.store.finish(result.labels())
        return result

    def _about(self, parts: Mapping[str, Any]) -> dict[str, Any]:
        scene, variants = self.scene, self.variants
        return {
            "title": f"sweep of {scene.title or source_name(scene.source)}",
            "source": f"GraspFX {__version__}",
            "scene": source_name(scene.source),
            "scene_table": json.dumps(parts["scene"]),
            "keys": json.dumps(variants.keys),
            "duration": parts["duration"],
            "sample": variants.sample,
            "seed": variants.seed if variants.sample else "",
            "identity": identity_of(parts),
            "created": now() if self.store is None else str(self.store.manifest["created"]),
        }


__all__ = ["SweepError", "SweepWarning", "sweep"]
