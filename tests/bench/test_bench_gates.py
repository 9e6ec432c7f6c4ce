"""Gates of speed: ratios within one run, at half of what was measured or less, never a time by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

import graspfx as gx
from graspfx.bench.timing import TIMED, Effort, Method, check, interleaved
from graspfx.grasp import point_sets
from tests.bench import batches, runs
from tests.bench.__main__ import module

BRIEF = Effort(rounds=9, batch=200_000, most=300_000_000, singles=1)
TRIES = 5  # as others use the processors too

FACE, POINTS = "GraspFX Grasp.split, Coupling.force", "GraspFX PointCoupling"
ONE, MANY = "5 fingers", "1000 grasps of 5 fingers, one call"
WALL, BY_EIGENVALUES = "device on a wall, 60 by 60", "numpy eigenvalues, Brent"
GRIP = "no friction, 5 fingers, gains 1000 : 1"


class Gate(NamedTuple):
    """How many times as long as a method of ours its peer takes, at least."""

    ours: str
    peer: str
    least: float


GATES = {
    "eq4": {
        ONE: [
            Gate(POINTS, "numpy pinv", 15.0),
            Gate(POINTS, "LAPACK dposv by scipy", 4.0),
            Gate(FACE, "numpy pinv", 2.5),
        ],
        "5 fingers, contacts fixed": [Gate(POINTS, "numpy, K known", 0.4)],
        MANY: [Gate(FACE, "numpy pinv, stacked", 12.0)],
    },
    "projection": {GRIP: [Gate("GraspFX unilateral_force", "Gauss-Seidel by numba to 1e-12", 0.05)]},
    "maps": {WALL: [Gate("GraspFX", BY_EIGENVALUES, 100.0)]},
    "contact": {"sphere, 320 triangles": [Gate("GraspFX, whole tick", "coal", 3.0)]},
    "startup": {"imports": [Gate("import graspfx", "import numpy", 0.77)]},
}
PACKAGES = {"coal": "coal", "Gauss-Seidel": "numba"}


def require_ratios(methods: Mapping[str, Method], gates: Sequence[Gate]) -> None:
    """Time all that gates compare in turns, again for those that were not met."""
    for _ in range(TRIES):
        names = sorted({name for gate in gates for name in (gate.ours, gate.peer)})
        times = dict(zip(names, map(min, interleaved([methods[each] for each in names], BRIEF)), strict=True))
        gates = [gate for gate in gates if times[gate.peer] < gate.least * times[gate.ours]]
        if not gates:
            return
    pytest.fail("\n".join(f"{gate}: {times[gate.ours]:.3g} us, its peer {times[gate.peer]:.3g} us" for gate in gates))


@pytest.mark.alone
@pytest.mark.parametrize("name", GATES)
def test_faster_than_its_peer_and_no_less_exact(name: str) -> None:
    pytest.importorskip("llvmlite")
    point_sets.warm()  # as `graspfx warmup` does
    left = dict(GATES[name])
    for case in module(name).cases(quick=True):
        gates = left.pop(case.name, [])
        methods = {method.name: method for method in case.methods}
        for gate in gates:
            if package := PACKAGES.get(gate.peer.split()[0]):
                pytest.importorskip(package)
            own, other = check(case, methods[gate.ours]), check(case, methods[gate.peer])
            assert (own.state, other.state) == (TIMED, TIMED)
            if own.error is not None:
                assert other.error is not None and own.error <= max(other.error, 4e-15)
        if gates:
            require_ratios(methods, gates)
        if not left:
            return
    pytest.fail(f"no such cases: {left}")


@pytest.mark.alone
def test_compiled_ticks_are_much_quicker_than_interpreted_ones() -> None:
    """Of whole runs of 2000 ticks, 60 times and more were measured."""
    pytest.importorskip("llvmlite")
    scene, methods = gx.load("paper-waving"), {}
    for engine, ticks in (("compiled", 2000), ("interpreted", 100)):
        run = partial(gx.run, scene.replace({"engine": engine}), duration=ticks * scene.period)
        methods[engine] = Method(engine, run, 0.0, calls=ticks)
    require_ratios(methods, [Gate("compiled", "interpreted", 15.0)])


@pytest.mark.alone
def test_a_long_run_to_disk_costs_little_more_than_one_in_memory(tmp_path: object) -> None:
    """The limits are about twice what was measured: 3 and 4 times."""
    pytest.importorskip("llvmlite")
    scene, seconds = runs.scene(runs.INTERNAL), 50_000 * runs.T
    methods = {
        "memory": Method("memory", partial(gx.run, scene, duration=seconds), 0.0),
        "summary": Method("summary", lambda: gx.run(scene, duration=seconds).summary(), 0.0),
        "disk": Method("disk", partial(gx.run, scene, duration=seconds, out=str(tmp_path), overwrite=True), 0.0),
    }
    require_ratios(methods, [Gate("disk", "memory", 1.0 / 8.0), Gate("summary", "memory", 1.0 / 8.0)])


@pytest.mark.alone
def test_a_tick_on_pybullet_is_little_more_than_pybullet() -> None:
    """Of the bare calls 1.1 was measured."""
    pytest.importorskip("llvmlite")
    pytest.importorskip("pybullet", reason="pybullet has no wheel for this Python or platform")
    methods = {method.name: method for method in runs.on_bullet(1000).methods}
    require_ratios(methods, [Gate("GraspFX session.step", "PyBullet, bare calls", 1.0 / 1.8)])


@pytest.mark.alone
def test_an_implicit_tick_costs_as_much_as_a_few_exact_ones() -> None:
    """Twenty fingers with friction, which a solver of every pair of contacts would feel: 1.4 times was measured."""
    pytest.importorskip("llvmlite")
    scene, methods = gx.load("twenty-fingers"), {}
    for integrator in ("exact", "implicit"):
        session = gx.open(scene.replace({"object.0.integrator": integrator, "engine": "compiled"}))
        methods[integrator] = Method(integrator, partial(session.step, 200), 0.0, calls=200)
    require_ratios(methods, [Gate("implicit", "exact", 0.25)])


@pytest.mark.alone
def test_a_batch_takes_a_part_of_runs_one_by_one() -> None:
    """Whole calls, of values of three keys and of a scene with friction and moving hands."""
    pytest.importorskip("llvmlite")
    rng = np.random.default_rng(7)
    values = {key: rng.uniform(*each, 400) for key, each in batches.RANGES.items()}
    friction = {batches.CONTACT[1]: np.linspace(*batches.CONTACT[2:], 256)}
    for scene, own, least in (("reference-1dof", values, 10.0), (batches.CONTACT[0], friction, 2.0)):
        variants = batches.Variants(gx.load(scene), own, ticks=200)
        methods = {method.name: method for method in batches.ours(variants)}
        variants.batch()  # compiled once
        require_ratios(methods, [Gate("GraspFX run_batch", "GraspFX gx.run one by one", least)])
