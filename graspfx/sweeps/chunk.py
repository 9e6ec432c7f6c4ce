"""Some variants of a sweep, run together in whatever process: measures, verdicts, faults, and what failed."""

from __future__ import annotations

import os
import pickle
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from threading import local
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx import __version__, plugins
from graspfx.analysis.blas_threads import one_blas_thread
from graspfx.assembly.provenance import digest_of, version_of
from graspfx.assembly.resolve import resolve
from graspfx.assembly.run import run
from graspfx.batch.group_runs import Measures, Runs, measured_variants
from graspfx.batch.measured_columns import columns_of
from graspfx.batch.part_memory import PartMemory
from graspfx.batch.row_measures import measures_of_recording
from graspfx.batch.variants import ForeignPartsError, Variants
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
_thread = local()  # of each thread the order that it works on, and the memory of its chunks
ALL = {"columns": [], "every": 1}  # what is recorded of a run that is measured afterwards
RUN = "run"  # the quantity that a run has as a whole
VERDICT = ("vibration", "unstable")  # its statistics


class SweepError(GraspFXError):
    """A sweep that cannot go on: its folder is another's, or a process of it has other files or another GraspFX."""


@dataclass(frozen=True)
class SceneOrder:
    """An order to run variants of a scene, which any process takes.

    Attributes:
        table: the scene as data.
        source: where it came from.
        trusted: whether it may name files outside of its folder.
        duration: instead of the scene's own [s].
        shapes: of the quantities that are measured, by name.
        statistics: of each.
        native: whether a first variant was native throughout.
        files: digests of the files that the scene names, by their path.
        engines: versions of the programs that move objects, by their distribution.
        home: the process that ordered.
        version: of GraspFX.
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
        """The order as bytes."""
        return pickle.dumps(self, protocol=pickle.HIGHEST_PROTOCOL)


@lru_cache(maxsize=2)
def take_order(content: bytes) -> tuple[SceneOrder, Scene]:
    """Make the scene of an order, once in a process.

    Raises:
        SweepError: this process has another GraspFX or other files than the one that ordered.
    """
    from graspfx.scene.model import Scene

    order: SceneOrder = pickle.loads(content)
    if order.version != __version__:
        raise SweepError(f"a worker has GraspFX {__version__}, the sweep {order.version}: install the same one")
    for package, version in order.engines.items():
        if version_of(package) != version:
            have = f"{package} {version_of(package)}"
            raise SweepError(f"a worker has {have}, the sweep {version}: install the same one on all machines")
    for name, digest in order.files.items():
        own = digest_of(name)
        if own != digest:
            state = "is not there" if own is None else "is another"
            raise SweepError(f"{name} {state} where a worker runs: give all machines the same files by the same paths")
    with permitted(order):
        return order, Scene(order.source, **order.table)


@contextmanager
def permitted(order: SceneOrder) -> Iterator[None]:
    """Trust what the order's user trusts, and look once for what is installed."""
    with granted(order.trusted), plugins.unchanged():
        yield


@dataclass(frozen=True)
class Chunk:
    """Some variants of a sweep.

    Attributes:
        number: of the chunk in its sweep.
        members: their numbers in the sweep, (V,).
        lists: by key, the values that they have.
        numbers: of the value that each key has in each variant, (V, keys).
    """

    number: int
    members: IndexArray
    lists: Mapping[str, list[Any]]
    numbers: IndexArray

    def __len__(self) -> int:
        return len(self.numbers)

    def overrides(self, variant: int) -> dict[str, Any]:
        """Give the values of one of them, by key."""
        return {key: self.lists[key][n] for key, n in zip(self.lists, self.numbers[variant].tolist(), strict=True)}

    def part(self, places: Sequence[int] | IndexArray) -> Chunk:
        """Give some of them, by their places in the chunk."""
        where = np.asarray(places, dtype=np.intp)
        return Chunk(self.number, self.members[where], self.lists, self.numbers[where])


@dataclass
class ChunkResult:
    """How variants went.

    Attributes:
        measures: by quantity and statistic, (V, *quantity); NaN where a variant failed. No zero has a sign.
        faults: the tick of each variant's first fault, -1 for none, (V,).
        failures: why a variant has no measures, empty where it has, (V,).
        notes: what took longer than it need have.
        seconds: that it took.
    """

    measures: Measures
    faults: IndexArray
    failures: list[str]
    notes: tuple[str, ...] = ()
    seconds: float = 0.0

    @classmethod
    def blank(cls, count: int, shapes: Mapping[str, tuple[int, ...]], statistics: Sequence[str]) -> ChunkResult:
        """Make the result of variants that have not run."""
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
        """Faults and measures by the names that they have in files; they are the result's own, to be filled in."""
        named = {f"{quantity}_{name}".replace("/", "_"): whole for quantity, name, whole in self._entries()}
        return {"fault_tick": self.faults, **named}

    def put(self, where: IndexArray, measures: Measures, faults: IndexArray) -> None:
        """Fill in some variants; a quantity may have been measured of them in another shape.

        Raises:
            InputError: it was.
        """
        for quantity, name, whole in self._entries():
            shape = measures[quantity][name].shape[1:]
            if shape != whole.shape[1:]:
                same = f"the shape {whole.shape[1:]} that it has in other variants"
                raise InputError("measure", f"{quantity} of shape {shape}", same)
        for quantity, name, whole in self._entries():
            whole[where] = measures[quantity][name] + 0.0  # the sign of a zero depends on the way to compute it
        self.faults[where] = faults

    def include(self, where: IndexArray, other: ChunkResult) -> None:
        """Fill in the results of a part, by its places."""
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
        content: the order, as bytes.
        chunk: the variants.
        threads: on which they run; by default all in the process that ordered, else one.

    Raises:
        SweepError: this process has other files or another GraspFX.
        MissingPackageError: a package that the whole sweep needs.
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
        """Run some variants together; say why they do not go so, empty if they do."""
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
    part = chunk.part(members)
    if RUN in order.shapes:
        with plugins.unchanged():
            variants = Variants(scene.replace({"record": ALL}), part.lists, part.numbers, memory=_thread.memory)
            groups = variants.groups()
        runs = Runs(variants.scene, variants, len(members), order.duration, threads)
        each = runs.recorded(groups, lambda recording: _measures(order, recording), whole=False)
        for k, member in enumerate(members.tolist()):
            result.put(np.array([member]), each[k], runs.faults[k : k + 1])
        result.notes += tuple(variants.notes)
        return
    measures, faults, notes = measured_variants(
        scene, part.lists, part.numbers, order.duration, list(order.shapes), order.statistics, threads, _thread.memory,
    )  # fmt: skip
    result.put(members, measures, faults)
    result.notes += notes


def _sorted(scene: Scene, chunk: Chunk, result: ChunkResult) -> tuple[list[int], list[int]]:
    """List the variants that run in a batch and those that run alone; what is no scene is a failure."""
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
    """Say on one line why a variant failed; of a scene its faults, as its values are beside it."""
    if isinstance(error, SceneError):
        return message(GraspFXError("; ".join(f"{fault.key}: {fault.message}" for fault in error.faults)))
    return message(error) or type(error).__name__


def forget() -> None:
    """Forget what serves further chunks in this thread."""
    _thread.__dict__.clear()


def _run_alone(order: SceneOrder, scene: Scene, chunk: Chunk, member: int, result: ChunkResult) -> None:
    """Run one variant as `gx.run` does, and measure what it recorded; a simulation only, whatever a value names."""
    try:
        variant = scene.replace({**chunk.overrides(member), "record": ALL})
        parts = resolve(variant)
        if parts.hardware:
            names = ", ".join(parts.hardware)
            raise InputError("scene", names, "simulated devices", "a sweep moves no hardware")
        recording = run(variant, duration=order.duration)
        measures = _measures(order, recording)
        fault = recording.faults[0].tick if recording.faults else -1
        result.put(np.array([member]), measures, np.array([fault]))
    except Exception as error:  # noqa: BLE001 - others' code may raise anything, and that is this variant's result
        result.failures[member] = reason(error)


def _measures(order: SceneOrder, recording: Recording) -> Measures:
    """Measure a recording, (1, *quantity): its rows, and the run as a whole by the criterion of its own summary."""
    measures = measures_of_recording(recording, [name for name in order.shapes if name != RUN], order.statistics)
    if RUN in order.shapes:
        shaking = vibration(recording.finger_force, recording.row_period)
        verdict = np.nan if shaking is None else shaking, float(bool(growths(recording)))
        measures[RUN] = {name: np.array([value]) for name, value in zip(VERDICT, verdict, strict=True)}
    return measures


def column_of(layout: Layout, quantity: str) -> Column:
    """Look up what a quantity of a sweep is.

    Raises:
        UnknownNameError: there is no such quantity.
    """
    if quantity != RUN:
        return columns_of(layout, [quantity])[0][quantity]
    meaning = "RMS over fingers and ticks of what is above 5 Hz in a finger's force; whether the run is seen to grow"
    return Column(RUN, slice(0, 0), (), (), "N", meaning)
