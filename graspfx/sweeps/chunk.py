"""Chunks: variants of a sweep that run together in any process, with their measures, faults and failures."""

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
    """Error of a sweep: its folder has another sweep, or its workers end, or have other files or package versions."""


@dataclass(frozen=True)
class SceneOrder:
    """An order to run variants of a scene in any process.

    Attributes:
        table: Table of the scene.
        source: Source of the scene.
        trusted: Whether the scene may name files outside its folder.
        duration: Duration that replaces the scene's [s].
        shapes: Shapes of the measured quantities, by name.
        statistics: Statistics of each quantity.
        native: Whether the examined variant consists of kernels only.
        files: Digests of the scene's files, by path.
        engines: Versions of the physics engines, by distribution.
        home: Host name and process number of the process that made the order.
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
        """The pickled order, for `run_chunk`."""
        return pickle.dumps(self, protocol=pickle.HIGHEST_PROTOCOL)


@lru_cache(maxsize=2)
def take_order(content: bytes) -> tuple[SceneOrder, Scene]:
    """Make the scene of an order, once per process.

    Raises:
        SweepError: If this process has another version of GraspFX or of a physics engine, or other files, than the
            process of the order.
    """
    from graspfx.scene.model import Scene

    order: SceneOrder = pickle.loads(content)
    if order.version != __version__:
        raise SweepError(
            f"a worker has GraspFX {__version__}, but the sweep has {order.version}: install the same on all machines"
        )
    for package, version in order.engines.items():
        if version_of(package) != version:
            have = f"{package} {version_of(package)}"
            raise SweepError(f"a worker has {have}, but the sweep has {version}: install the same on all machines")
    for name, digest in order.files.items():
        own = digest_of(name)
        if own != digest:
            state = "is missing" if own is None else "is different"
            raise SweepError(f"{name} {state} on a worker: give all machines the same files at the same paths")
    with permitted(order):
        return order, Scene(order.source, **order.table)


@contextmanager
def permitted(order: SceneOrder) -> Iterator[None]:
    """Apply the order's trust setting, and look up installed packages once."""
    with granted(order.trusted), plugins.unchanged():
        yield


@dataclass(frozen=True)
class Chunk:
    """Some variants of a sweep.

    Attributes:
        number: Index of the chunk in its sweep.
        members: Indices of the variants in the sweep, (V,).
        lists: Values of the variants by key.
        numbers: Index of each key's value in each variant, (V, keys).
    """

    number: int
    members: IndexArray
    lists: Mapping[str, list[Any]]
    numbers: IndexArray

    def __len__(self) -> int:
        return len(self.numbers)

    def overrides(self, variant: int) -> dict[str, Any]:
        """Return the values of one variant, by key."""
        return {key: self.lists[key][n] for key, n in zip(self.lists, self.numbers[variant].tolist(), strict=True)}

    def part(self, places: Sequence[int] | IndexArray) -> Chunk:
        """Return a chunk of some variants, by their positions."""
        where = np.asarray(places, dtype=np.intp)
        return Chunk(self.number, self.members[where], self.lists, self.numbers[where])


@dataclass
class ChunkResult:
    """Results of variants.

    Attributes:
        measures: Measures by quantity and statistic, (V, *quantity); NaN for failed variants. Every zero is positive.
        faults: Tick of each variant's first fault, -1 for none, (V,).
        failures: Reason why a variant has no measures, otherwise empty, (V,).
        notes: Reasons for longer computing times.
        seconds: Computing time [s].
    """

    measures: Measures
    faults: IndexArray
    failures: list[str]
    notes: tuple[str, ...] = ()
    seconds: float = 0.0

    @classmethod
    def blank(cls, count: int, shapes: Mapping[str, tuple[int, ...]], statistics: Sequence[str]) -> ChunkResult:
        """Make a result of `count` variants in which every measure is NaN, without faults and failures."""
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
        """Faults and measures by their names in files, as writable arrays of the result."""
        named = {f"{quantity}_{name}".replace("/", "_"): whole for quantity, name, whole in self._entries()}
        return {"fault_tick": self.faults, **named}

    def put(self, where: IndexArray, measures: Measures, faults: IndexArray) -> None:
        """Write measures and fault ticks of the variants at the positions `where`.

        Raises:
            InputError: If a quantity has another shape for these variants.
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
        """Fill in the results of a part at its positions."""
        for quantity, name, whole in self._entries():
            whole[where] = other.measures[quantity][name]
        self.faults[where] = other.faults
        for place, text in zip(where.tolist(), other.failures, strict=True):
            self.failures[place] = text
        self.notes = tuple(dict.fromkeys([*self.notes, *other.notes]))
        self.seconds += other.seconds


def run_chunk(content: bytes, chunk: Chunk, threads: int | None = None) -> ChunkResult:
    """Run the variants of a chunk, in this process.

    Args:
        content: Order as bytes.
        chunk: Variants to run.
        threads: Number of threads; by default one per processor in the process that made the order, one in others.

    Raises:
        SweepError: If this process has other files, or another version of GraspFX or of a physics engine.
        MissingPackageError: If llvmlite, which all native variants need, is missing.
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
        """Run some variants together; return the reason if this is impossible, otherwise an empty text."""
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
    """List the variants that run in a batch and those that run alone; invalid scenes become failures."""
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
    """Return the reason of a variant's failure in one line; for an invalid scene, its faults."""
    if isinstance(error, SceneError):
        return message(GraspFXError("; ".join(f"{fault.key}: {fault.message}" for fault in error.faults)))
    return message(error) or type(error).__name__


def forget() -> None:
    """Clear the memory that this thread keeps for further chunks."""
    _thread.__dict__.clear()


def _run_alone(order: SceneOrder, scene: Scene, chunk: Chunk, member: int, result: ChunkResult) -> None:
    """Run one variant as `gx.run` does, and measure its recording; simulations only."""
    try:
        variant = scene.replace({**chunk.overrides(member), "record": ALL})
        parts = resolve(variant)
        if parts.hardware:
            names = ", ".join(parts.hardware)
            raise InputError("scene", names, "simulated devices", "a sweep does not run hardware")
        recording = run(variant, duration=order.duration)
        measures = _measures(order, recording)
        fault = recording.faults[0].tick if recording.faults else -1
        result.put(np.array([member]), measures, np.array([fault]))
    except Exception as error:  # noqa: BLE001 - third-party code may raise anything, which is this variant's result
        result.failures[member] = reason(error)


def _measures(order: SceneOrder, recording: Recording) -> Measures:
    """Measure a recording, (1, *quantity): its rows, and the whole run by the criterion of its summary."""
    measures = measures_of_recording(recording, [name for name in order.shapes if name != RUN], order.statistics)
    if RUN in order.shapes:
        shaking = vibration(recording.finger_force, recording.row_period)
        verdict = np.nan if shaking is None else shaking, float(bool(growths(recording)))
        measures[RUN] = {name: np.array([value]) for name, value in zip(VERDICT, verdict, strict=True)}
    return measures


def column_of(layout: Layout, quantity: str) -> Column:
    """Return the description of a quantity of a sweep.

    Raises:
        UnknownNameError: If the quantity does not exist.
    """
    if quantity != RUN:
        return columns_of(layout, [quantity])[0][quantity]
    meaning = "RMS over fingers and ticks of a finger's force above 5 Hz; whether the run grows"
    return Column(RUN, slice(0, 0), (), (), "N", meaning)


def measures_of_recording(recording: Recording, measure: Sequence[str], statistics: Sequence[str]) -> Measures:
    """Measure a recording of all columns and ticks, by quantity and statistic, (1, *quantity)."""
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
