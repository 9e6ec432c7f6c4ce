"""Thousands of variants, whole calls, beside arrays of numpy and runs one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.batch.group_runs import Runs
from graspfx.batch.variants import Variants
from graspfx.bench.case import Case, Method, is_installed, missing
from graspfx.bench.peers.arrays import last_positions, one_dof
from graspfx.environment import processors
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
Values = dict[str, FloatArray]

TITLE = "Batches"
LIMITS = """
Time is that of a whole call, from the scene and the values to the last positions of both fingers and of the object, per
variant; the first call of a process takes its programs from the cache, or compiles them. `run_batch` builds and checks
a few variants, some tens of milliseconds in all, which is most of the time of a thousand points: "its runs alone" is
what is left without that. Other keys than gains, friction, masses and viscosities are built for every value. One by one
is `gx.run(scene.replace(...))`, as a user writes it, for a few of the variants. The arrays of numpy are for this one
system and nothing else; to write them takes an hour. The error is that of the last positions against single runs,
relative to the largest of them; for scenes with contact there are no other arrays than single runs. A call of some
seconds is timed once.
"""

STIFFNESS, VISCOSITY, MASS = "coupling.external.stiffness", "object.viscosity", "object.mass"
RANGES = {STIFFNESS: (5.0, 60.0), VISCOSITY: (0.6, 1.5), MASS: (0.05, 0.2)}
CONTACTS = (  # scenes in which fingers let go or slip, each with a key and its range
    ("paper-spring", "coupling.internal.stiffness", 60.0, 100.0),
    ("sphere-three-fingers", "coupling.friction", 0.3, 0.9),
)
BOUND = 1e-12
CHECKED = 12
SINGLES = 10  # variants that are run one by one
QUANTITIES: Mapping[str, Any] = {"measure": ["finger_position", "object_position"], "statistics": ["last"]}


@dataclass(frozen=True)
class BatchProblem:
    """Variants of a scene.

    Attributes:
        scene: the scene.
        values: by dotted key, of each variant, (V,).
        ticks: of each run.
    """

    scene: Scene
    values: Values
    ticks: int

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    @property
    def seconds(self) -> float:
        return self.ticks * self.scene.period

    @cached_property
    def reference(self) -> tuple[Any, FloatArray]:
        """Numbers of a few variants, and their last positions by single runs, (CHECKED, n d + d) [m]."""
        numbers = np.random.default_rng(3).integers(0, len(self), CHECKED)
        return numbers, np.stack([self.single_run(k) for k in numbers])

    def error(self, last: FloatArray) -> float:
        """Compare last positions (V, n d + d) with those of single runs: the largest difference, relative."""
        numbers, expected = self.reference
        return float((np.abs(last[numbers] - expected).max(axis=1) / np.abs(expected).max(axis=1)).max())

    def single_run(self, k: int, **more: Any) -> FloatArray:
        """Run one variant by itself; its last positions [m], (3,) on a line with two fingers."""
        run = gx.run(
            self.scene.replace({key: float(each[k]) for key, each in self.values.items()} | more),
            duration=self.seconds,
        )
        return np.concatenate([run.finger_position[-1].ravel(), run.object_position[-1]])

    def arrays(self) -> FloatArray:
        """Run all variants as arrays of numpy; their last positions (V, 3) [m]."""
        own = {STIFFNESS: self.scene.coupling.external.stiffness, VISCOSITY: self.scene.object[0].viscosity,
               MASS: self.scene.object[0].mass}  # fmt: skip
        columns = [self.values.get(key, np.full(len(self), float(np.asarray(each)))) for key, each in own.items()]
        stiffness, viscosity, mass = columns
        return last_positions(one_dof(self.scene), stiffness, viscosity, mass, self.ticks)


def cases(quick: bool) -> Iterator[Case]:
    """Compare whole calls for values of one key, for random points of two and three, and for a grid of two."""
    many, points, side, ticks = (200, 50, 20, 200) if quick else (10_000, 1000, 100, 1000)
    scene, rng = gx.load("reference-1dof"), np.random.default_rng(7)
    one = BatchProblem(scene, {STIFFNESS: np.linspace(*RANGES[STIFFNESS], many)}, ticks)
    yield _case(f"{many} values of one key, {ticks} ticks", one, one.values, _one_by_one(one))
    for count, word in ((2, "two"), (3, "three")):
        keys = list(RANGES)[:count]
        random = BatchProblem(scene, {key: rng.uniform(*RANGES[key], points) for key in keys}, ticks)
        yield _case(f"{points} random points of {word} keys, {ticks} ticks", random, random.values, _one_by_one(random))
    lists = {key: np.linspace(*RANGES[key], side) for key in (STIFFNESS, VISCOSITY)}
    grid = np.stack(np.meshgrid(*lists.values(), indexing="ij"), axis=-1).reshape(-1, 2)
    product = BatchProblem(scene, dict(zip(lists, grid.T, strict=True)), ticks)
    yield _case(f"{side} by {side} values of two keys, {ticks} ticks", product, lists, _runs_alone(product))

    for name, key, lowest, highest in CONTACTS:
        yield _contact_case(gx.load(name), key, np.linspace(lowest, highest, 16 if quick else 10_000), ticks)


def _contact_case(scene: Scene, key: str, values: FloatArray, ticks: int) -> Case:
    """Compare variants of a scene whose fingers let go or slip with single runs."""
    problem = BatchProblem(scene, {key: values}, ticks)
    first, *_ = whole_calls(problem, problem.values)  # again would take as long
    methods = [first, *_one_by_one(problem)]
    return Case("batches", f"{scene.source.name}, {len(values)} values, {ticks} ticks", "relative", methods, BOUND)


def _case(name: str, problem: BatchProblem, lists: Values, more: Iterator[Method]) -> Case:
    methods = [*whole_calls(problem, lists), *more, by_numpy(problem)]
    return Case("batches", name, "relative", methods, BOUND)


def whole_calls(problem: BatchProblem, lists: Values) -> Iterator[Method]:
    """Call `run_batch` like a user, the first time and again; with lists as long as the batch, point by point."""
    first, again, V = "GraspFX run_batch, the first one of a process", "GraspFX run_batch", len(problem)
    if not is_installed("llvmlite"):
        yield missing(again, "llvmlite")
        return
    by_points = len(next(iter(lists.values()))) == V
    batches: list[Any] = []

    def call() -> None:
        batches[:] = [gx.run_batch(problem.scene, lists, problem.seconds, zip=by_points, **QUANTITIES)]

    def error() -> float:
        if not batches:
            call()
        fingers, thing = (batches[0][quantity]["last"].reshape(V, -1) for quantity in QUANTITIES["measure"])
        return problem.error(np.concatenate([fingers, thing], axis=1))

    yield Method(first, call, error, "compiles what is not in the cache", calls=V, once=True)
    yield Method(again, call, error, calls=V)


def _one_by_one(problem: BatchProblem) -> Iterator[Method]:
    """Time `gx.run` of a few variants, by its default engine and compiled."""
    for name, more in (("gx.run one by one", {}), ("gx.run one by one, compiled", {"engine": "compiled"})):
        if more and not is_installed("llvmlite"):
            yield missing(f"GraspFX {name}", "llvmlite")
            continue
        yield Method(f"GraspFX {name}", partial(_run_each, problem, more), 0.0, "what is compared with", calls=SINGLES)


def _run_each(problem: BatchProblem, more: Mapping[str, Any]) -> None:
    for k in range(SINGLES):
        problem.single_run(k, **more)


def _runs_alone(problem: BatchProblem) -> Iterator[Method]:
    """Run the variants of a batch that are built and whose programs are known."""
    if not is_installed("llvmlite"):
        yield missing("GraspFX run_batch, its runs alone", "llvmlite")
        return
    unique = {key: sorted(set(each.tolist())) for key, each in problem.values.items()}
    columns = [np.searchsorted(unique[key], each) for key, each in problem.values.items()]
    variants = Variants(problem.scene, unique, np.stack(columns, axis=1))
    groups = variants.groups()
    for threads, note in ((processors(), "every processor"), (1, "one processor")):
        runs = Runs(problem.scene, variants, len(problem), problem.seconds, threads)
        measure = partial(runs.measured, groups, QUANTITIES["measure"], QUANTITIES["statistics"])
        yield Method(
            f"GraspFX run_batch, its runs alone, {note}", measure, partial(_error_of_measures, problem, measure),
            "not what a user waits for", calls=len(problem),
        )  # fmt: skip


def _error_of_measures(problem: BatchProblem, measure: Callable[[], Any]) -> float:
    measures = measure()
    parts = [measures[quantity]["last"].reshape(len(problem), -1) for quantity in QUANTITIES["measure"]]
    return problem.error(np.concatenate(parts, axis=1))


def by_numpy(problem: BatchProblem) -> Method:
    return Method(
        "numpy, arrays of variants", problem.arrays, lambda: problem.error(problem.arrays()), calls=len(problem)
    )  # fmt: skip
