"""Chunks of a sweep: groups of variants that one process runs together, and their results."""

from __future__ import annotations

import os
import pickle
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from math import prod
from threading import local
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx import __version__, plugins
from graspfx.analysis.blas_threads import one_blas_thread
from graspfx.assembly.provenance import digest_of, version_of
from graspfx.assembly.resolve import resolve
from graspfx.assembly.run_scene import run
from graspfx.batch.group_runs import Measures, Runs
from graspfx.batch.measured_columns import columns_of, empty, statistic, take
from graspfx.batch.variants import ForeignPartsError, PartMemory, Variants
from graspfx.environment import granted, processors
from graspfx.errors import GraspFXError, InputError, MissingPackageError, SceneError, message
from graspfx.loop.columns import Column, Layout
from graspfx.recording.growth import growths
from graspfx.recording.record import Recording
from graspfx.recording.vibration import vibration
from graspfx.scene.source import Source

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

COMPILER = "llvmlite"
_thread = local()  # current order, and memory for its chunks, of each thread
ALL = {"columns": [], "every": 1}  # recorded columns of a run that is measured afterwards
RUN = "run"  # quantity of a whole run
VERDICT = ("vibration", "unstable")  # statistics of the quantity RUN


class SweepError(GraspFXError):
    """Error of a sweep.

    The folder contains another sweep, the workers end, or the workers have other files or other versions of packages.
    """


@dataclass(frozen=True)
class SceneOrder:
    """Specification of a sweep, from which any process can run variants.

    Attributes:
        table: Table of the scene.
        source: Source of the scene.
        trusted: Whether the scene may refer to files outside its folder.
        duration: Duration of each run [s]; None for the scene's duration.
        shapes: Shape of each measured quantity, by the quantity's name.
        statistics: Names of the statistics of each quantity.
        native: Whether all parts of the examined variant are kernels, so that variants run in batches.
        files: Digest of each file of the scene, by path.
        engines: Version of each physics engine, by the name of its distribution.
        home: Host name and process number of the process that created the specification.
        version: Version of GraspFX.
    """

    table: Mapping[str, Any]
    source: Source
    trusted: bool
    duration: float | None
    shapes: Mapping[str, tuple[int, ...]]
    statistics: tuple[str, ...]
    native: bool
    files: Mapping[str, str]
    engines: Mapping[str, str]
    home: tuple[str, int]
    version: str = __version__

    @property
    def bytes(self) -> bytes:
        """The pickled specification, an argument of `run_chunk`."""
        return pickle.dumps(self, protocol=pickle.HIGHEST_PROTOCOL)


@lru_cache(maxsize=2)
def take_order(content: bytes) -> tuple[SceneOrder, Scene]:
    """Unpickle a specification and create its scene; results are cached.

    Raises:
        SweepError: If GraspFX, a physics engine or a file of the scene differs from that of the process that created
            the specification.
    """
    from graspfx.scene.model import Scene

    order: SceneOrder = pickle.loads(content)
    if order.version != __version__:
        raise SweepError(
            f"a worker has GraspFX {__version__}, but the sweep has {order.version}: "
            "install the same version on all machines"
        )
    for package, version in order.engines.items():
        if version_of(package) != version:
            have = f"{package} {version_of(package)}"
            raise SweepError(
                f"a worker has {have}, but the sweep has {version}: install the same version on all machines"
            )
    for name, digest in order.files.items():
        own = digest_of(name)
        if own != digest:
            state = "is missing" if own is None else "is different"
            raise SweepError(f"{name} {state} on a worker: give all machines the same files at the same paths")
    with permitted(order):
        return order, Scene(order.source, **order.table)


@contextmanager
def permitted(order: SceneOrder) -> Iterator[None]:
    """Apply the setting `trusted` within the `with` block, and look up installed packages only once."""
    with granted(order.trusted), plugins.unchanged():
        yield


@dataclass(frozen=True)
class Chunk:
    """A group of V variants of a sweep.

    Attributes:
        number: Index of the chunk in the sweep.
        members: Indices of the variants in the sweep (V,).
        lists: For each key, the list of the values that occur in the variants.
        numbers: For each variant and key, the index of the value in the key's list (V, keys).
    """

    number: int
    members: IndexArray
    lists: Mapping[str, list[Any]]
    numbers: IndexArray

    def __len__(self) -> int:
        return len(self.numbers)

    def overrides(self, variant: int) -> dict[str, Any]:
        """Return the values of one variant, by key, for `scene.replace`."""
        return {key: self.lists[key][n] for key, n in zip(self.lists, self.numbers[variant].tolist(), strict=True)}

    def part(self, places: Sequence[int] | IndexArray) -> Chunk:
        """Return a chunk of the variants at the given positions in this chunk."""
        where = np.asarray(places, dtype=np.intp)
        return Chunk(self.number, self.members[where], self.lists, self.numbers[where])


@dataclass
class ChunkResult:
    """Results of V variants.

    Attributes:
        measures: For each quantity and statistic, an array (V, *quantity); NaN for failed variants. The arrays do not
            contain -0.0.
        faults: Tick of the first fault of each variant (V,); -1 for a variant without a fault.
        failures: For each variant, the reason why it has no measures; empty if it has measures (V,).
        notes: Reasons why the computation took longer than usual.
        seconds: Computing time [s].
    """

    measures: Measures
    faults: IndexArray
    failures: list[str]
    notes: tuple[str, ...] = ()
    seconds: float = 0.0

    @classmethod
    def blank(cls, count: int, shapes: Mapping[str, tuple[int, ...]], statistics: Sequence[str]) -> ChunkResult:
        """Return a result of `count` variants without faults and failures, in which all measures are NaN."""
        measures = {
            quantity: {name: np.full((count, *shape), np.nan) for name in (VERDICT if quantity == RUN else statistics)}
            for quantity, shape in shapes.items()
        }
        return cls(measures, np.full(count, -1), [""] * count)

    def __len__(self) -> int:
        return len(self.faults)

    def _entries(self) -> Iterator[tuple[str, str, NDArray[Any]]]:
        for quantity, by_name in self.measures.items():
            for name, whole in by_name.items():
                yield quantity, name, whole

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays of faults and measures, by their names in files; writing to an array changes this result."""
        named = {f"{quantity}_{name}".replace("/", "_"): whole for quantity, name, whole in self._entries()}
        return {"fault_tick": self.faults, **named}

    def put(self, where: IndexArray, measures: Measures, faults: IndexArray) -> None:
        """Store the measures and fault ticks of the variants at the positions `where`.

        Raises:
            InputError: If the shape of a quantity differs from its shape in other variants.
        """
        for quantity, name, whole in self._entries():
            shape = measures[quantity][name].shape[1:]
            if shape != whole.shape[1:]:
                same = f"the shape {whole.shape[1:]} that it has in other variants"
                raise InputError("measure", f"{quantity} of shape {shape}", same)
        for quantity, name, whole in self._entries():
            whole[where] = measures[quantity][name] + 0.0  # the sign of a zero depends on the way of computing
        self.faults[where] = faults

    def include(self, where: IndexArray, other: ChunkResult) -> None:
        """Store the results of some of the variants, at the positions `where`."""
        for quantity, name, whole in self._entries():
            whole[where] = other.measures[quantity][name]
        self.faults[where] = other.faults
        for place, text in zip(where.tolist(), other.failures, strict=True):
            self.failures[place] = text
        self.notes = tuple(dict.fromkeys([*self.notes, *other.notes]))
        self.seconds += other.seconds


def run_chunk(content: bytes, chunk: Chunk, threads: int | None = None) -> ChunkResult:
    """Run the variants of a chunk in this process.

    Args:
        content: Pickled specification of the sweep (`SceneOrder.bytes`).
        chunk: Variants to run.
        threads: Number of threads. By default, the process that created the specification uses one thread per
            processor, and any other process uses one thread.

    Raises:
        SweepError: If this process has other files, or another version of GraspFX or of a physics engine, than the
            process that created the specification.
        MissingPackageError: If llvmlite is not installed.
    """
    began = perf_counter()
    order, scene = take_order(content)
    if getattr(_thread, "content", None) != content:
        _thread.content, _thread.memory = content, PartMemory()
    at_home = (socket.gethostname(), os.getpid()) == order.home
    threads = (processors() if at_home else 1) if threads is None else threads
    with permitted(order), one_blas_thread():
        result = _result(order, scene, chunk, threads)
    result.seconds = perf_counter() - began
    return result


def _result(order: SceneOrder, scene: Scene, chunk: Chunk, threads: int) -> ChunkResult:
    result = ChunkResult.blank(len(chunk), order.shapes, order.statistics)

    def refusal(members: Sequence[int]) -> str:
        """Run the given variants in a batch; return the reason if this fails, or an empty text if it succeeds."""
        try:
            _batch(order, scene, chunk, np.array(members), threads, result)
        except GraspFXError as error:
            if isinstance(error, MissingPackageError) and error.package == COMPILER:
                raise
            return reason(error)
        return ""

    everyone = range(len(chunk))
    if order.native and not refusal(everyone):
        return result
    alike, alone = _sorted(scene, chunk, result) if order.native else ([], list(everyone))
    if alike and refusal(alike):
        for member in alike:
            result.failures[member] = refusal([member])
    for member in alone:
        _run_alone(order, scene, chunk, member, result)
    return result


def _batch(
    order: SceneOrder, scene: Scene, chunk: Chunk, members: IndexArray, threads: int, result: ChunkResult
) -> None:
    part, with_run = chunk.part(members), RUN in order.shapes
    scene = scene.replace({"record": ALL}) if with_run else scene
    runs = Runs(scene, part.lists, part.numbers, order.duration, threads, _thread.memory)
    if with_run:
        each = runs.recorded(lambda recording: _measures(order, recording), whole=False)
        for k, member in enumerate(members.tolist()):
            result.put(np.array([member]), each[k], runs.faults[k : k + 1])
    else:
        result.put(members, runs.measured(list(order.shapes), order.statistics), runs.faults)
    result.notes += tuple(runs.variants.notes)


def _sorted(scene: Scene, chunk: Chunk, result: ChunkResult) -> tuple[list[int], list[int]]:
    """Return the variants that can run in a batch, and the variants that run separately.

    For variants that are not valid scenes, the reason is stored in the failures of `result`.
    """
    variants = Variants(scene, chunk.lists, chunk.numbers)
    alike, alone = [], []
    for member, numbers in enumerate(chunk.numbers):
        try:
            variants.built(numbers)
        except ForeignPartsError:
            alone.append(member)
        except GraspFXError as error:
            result.failures[member] = reason(error)
        else:
            alike.append(member)
    return alike, alone


def reason(error: Exception) -> str:
    """Return the message of an error in one line; for an invalid scene, all faults of the scene."""
    if isinstance(error, SceneError):
        return message(GraspFXError("; ".join(f"{fault.key}: {fault.message}" for fault in error.faults)))
    return message(error) or type(error).__name__


def forget() -> None:
    """Delete the data that this thread caches between chunks."""
    _thread.__dict__.clear()


def _run_alone(order: SceneOrder, scene: Scene, chunk: Chunk, member: int, result: ChunkResult) -> None:
    """Run one variant of simulated devices by `run`, and store the measures of its recording in `result`."""
    try:
        variant = scene.replace({**chunk.overrides(member), "record": ALL})
        parts = resolve(variant)
        if parts.hardware:
            names = ", ".join(parts.hardware)
            raise InputError("scene", names, "simulated devices", "a sweep cannot run hardware")
        recording = run(variant, duration=order.duration)
        measures = _measures(order, recording)
        fault = recording.faults[0].tick if recording.faults else -1
        result.put(np.array([member]), measures, np.array([fault]))
    except Exception as error:  # noqa: BLE001 - third-party code may raise anything, which is this variant's result
        result.failures[member] = reason(error)


def _measures(order: SceneOrder, recording: Recording) -> Measures:
    """Compute the measures (1, *quantity) of a recording, including those of the quantity "run"."""
    measures = measures_of_recording(recording, [name for name in order.shapes if name != RUN], order.statistics)
    if RUN in order.shapes:
        shaking = vibration(recording.finger_force, recording.row_period)
        verdict = np.nan if shaking is None else shaking, float(bool(growths(recording)))
        measures[RUN] = {name: np.array([value]) for name, value in zip(VERDICT, verdict, strict=True)}
    return measures


def column_of(layout: Layout, quantity: str) -> Column:
    """Return the name, dimensions, unit and meaning of a quantity of a sweep.

    Raises:
        UnknownNameError: If there is no quantity with this name.
    """
    if quantity != RUN:
        return columns_of(layout, [quantity])[0][quantity]
    meaning = "vibration: RMS over fingers and ticks of the force above 5 Hz; unstable: 1 if an oscillation grows"
    return Column(RUN, slice(0, 0), (), (), "N", meaning)


def measures_of_recording(recording: Recording, measure: Sequence[str], statistics: Sequence[str]) -> Measures:
    """Compute statistics of quantities of a recording that contains all columns and ticks.

    Returns:
        For each quantity and statistic, an array (1, *quantity).
    """
    columns, _ = columns_of(recording.layout, measure)
    out: Measures = {}
    for quantity, column in columns.items():
        values = recording.array(column.name)
        raw = empty(prod(column.shape))
        take(values.reshape(len(values), -1), raw, 0, len(values))
        out[quantity] = {
            name: np.asarray(statistic(name, raw, len(values))).reshape(1, *column.shape) for name in statistics
        }
    return out
