"""Eq. (4): forces of all contacts from their points and displacements, over fingers and over conditioning."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.bench.case import Case, Method, each, is_installed, missing
from graspfx.bench.contact_sets import ContactSet, contact_sets
from graspfx.bench.eq4_peers import PEERS, Project, grasp_matrix
from graspfx.bench.exact import split_force
from graspfx.compile.machine import compiled
from graspfx.coupling import block as at
from graspfx.coupling.grasped import GraspedObject, Rules
from graspfx.coupling.law import bilateral
from graspfx.coupling.sample import resplit
from graspfx.grasp import direct
from graspfx.grasp.point_coupling import PointCoupling
from graspfx.objects import kernels as body

FloatArray = NDArray[np.float64]
Pair = tuple[FloatArray, FloatArray]

TITLE = "Eq. (4)"
LIMITS = """
Contacts change at every call, so that each method starts from points; the cached projector shows what is left where
they do not. Peers build G about the origin and use their library's tolerance for the rank, or what stands in for it;
where 1 km or a line defeats that, a reader who centres the points first gets more digits. Contacts nearer to a line
than 1e-6 of their radius count as on it, 1e-12 in the cases of a given condition. Equal weights, hard fingers in space,
no damping.
"""

EXTERNAL, INTERNAL = 30.0, 70.0  # [N/m]
WRONG = 1e-3  # of a force: more is no matter of rounding


def cases(quick: bool) -> Iterator[Case]:
    for given in contact_sets(quick):
        pairs = list(zip(given.points, given.displacements, strict=True))
        exact = np.array([split_force(p, e, EXTERNAL, INTERNAL, given.tolerance) for p, e in pairs])
        yield Case("eq4", given.name, "relative", [*_ours(given, exact), *_peers(given, pairs, exact)], WRONG)


def _peers(given: ContactSet, pairs: Sequence[Pair], exact: FloatArray) -> Iterator[Method]:
    for name, project in PEERS.items():
        if name.startswith("scipy") and not is_installed("scipy"):
            yield missing(name, "scipy")
        else:
            yield _method(name, _by(project), pairs, exact)
    known = {p.tobytes(): np.linalg.pinv(G := grasp_matrix(p)) @ G for p in given.points}
    cached = [(known[p.tobytes()] * (EXTERNAL - INTERNAL), e.ravel()) for p, e in pairs]
    yield _method("numpy, P known", lambda x: x[0] @ x[1] + INTERNAL * x[1], cached, exact, "contacts do not move")


def _by(project: Project) -> Callable[[Pair], FloatArray]:
    def force(pair: Pair) -> FloatArray:
        e = pair[1].ravel()
        return INTERNAL * e + project(grasp_matrix(pair[0]), (EXTERNAL - INTERNAL) * e)

    return force


def _ours(given: ContactSet, exact: FloatArray) -> Iterator[Method]:
    law = gx.Coupling(gx.Impedance(EXTERNAL), gx.Impedance(INTERNAL))

    def by_split(pair: Pair) -> FloatArray:
        return law.force(gx.Split(gx.Grasp(pair[0]), tolerance=given.tolerance), pair[1].ravel())

    pairs = list(zip(given.points, given.displacements, strict=True))
    yield _method("GraspFX Split", by_split, pairs, exact)
    for engine in ("interpreted", "compiled"):
        yield from _direct(given, exact, law, engine)
    blocks, n = _blocks(law, given), given.points.shape[1]
    calls: list[Callable[[], object]] = [partial(sample, memoryview(block)) for block in blocks]
    yield _tick("GraspFX tick, interpreted", calls, blocks, n, exact)
    if not is_installed("llvmlite"):
        yield missing("GraspFX tick, compiled", "llvmlite")
        return
    yield _tick("GraspFX tick, compiled", [compiled(sample).bound(block) for block in blocks], blocks, n, exact)


def _direct(given: ContactSet, exact: FloatArray, law: gx.Coupling, engine: str) -> Iterator[Method]:
    """The direct kernel, a call for each grasp and one call for all of them."""
    if engine == "compiled" and not is_installed("llvmlite"):
        yield missing("GraspFX PointCoupling, compiled", "llvmlite")
        return
    N, n, _ = given.points.shape
    own = [PointCoupling(law.external, law.internal, n, tolerance=given.tolerance, engine=engine) for _ in range(N)]
    for each_own, points, e in zip(own, given.points, given.displacements, strict=True):
        each_own.points[:], each_own.displacement[:] = points, e

    def force(one: PointCoupling) -> FloatArray:
        one.compute()
        return one.force

    def computed() -> float:
        return _error(np.array([force(one) for one in own]), exact)

    calls = each(lambda compute: compute(), [one.compute for one in own])
    yield Method(f"GraspFX PointCoupling, {engine}", calls, computed, "inputs in place", N)
    if engine == "interpreted":
        return

    def written(pair: Pair) -> FloatArray:
        one = own[0]
        one.points[:], one.displacement[:] = pair
        one.compute()
        return one.force.copy()

    pairs = list(zip(given.points, given.displacements, strict=True))
    yield _method("GraspFX PointCoupling, compiled, copying", written, pairs, exact, "inputs and forces copied")
    size = direct.size(n, 3)
    block = np.zeros((N, size))
    block[:, : direct.RANK] = [n, 3, EXTERNAL, 0.0, INTERNAL, 0.0, given.tolerance]
    block[:, direct.POINTS : direct.POINTS + 6 * n] = np.hstack(
        [given.points.reshape(N, -1), given.displacements.reshape(N, -1)]
    )
    kernel, flat = compiled(couple_all), block.ravel()

    def error() -> float:
        kernel(flat, N, size)
        return _error(block[:, direct.POINTS + 9 * n :].reshape(N, n, 3), exact)

    yield Method("GraspFX direct kernel, compiled", lambda: kernel(flat, N, size), error, calls=N)


def couple_all(S: Any, N: int, size: int) -> None:
    """Forces of N blocks of one size from their points, in one call."""
    for k in range(N):
        direct.couple_points(S, k * size)


def sample(S: Any) -> None:
    """Split and forces of one block, as a sample makes them once contacts have moved."""
    S[at.SPLIT_KNOWN] = 0.0
    resplit(S)
    bilateral(S, True, False)


def _blocks(law: gx.Coupling, given: ContactSet) -> list[FloatArray]:
    """The state block of a grasped object for every grasp."""
    n = given.points.shape[1]
    filled = []
    for points, e in zip(given.points, given.displacements, strict=True):
        arm = given.tolerance * float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum() / n))
        rules = Rules(attached=True, blend=(arm, arm))
        grasped = GraspedObject(n, 3, 0.001, law, rules, _free)
        grasped.rows[:, at.CONTACT : at.CONTACT + 3] = points
        grasped.rows[:, at.DISPLACEMENT : at.DISPLACEMENT + 3] = e
        filled.append(grasped.block)
    return filled


def _free(state: FloatArray) -> None:
    state[body.FREE : body.FREE + 6] = 1.0


def _tick(
    name: str, calls: Sequence[Callable[[], object]], blocks: Sequence[FloatArray], n: int, exact: FloatArray
) -> Method:
    def run() -> None:
        for call in calls:
            call()

    def error() -> float:
        run()
        rows = np.array([block[at.ROW : at.ROW + n * at.STRIDE].reshape(n, at.STRIDE) for block in blocks])
        return _error(rows[:, :, at.LOCAL : at.LOCAL + 3], exact)

    return Method(name, run, error, calls=len(calls))


def _method(
    name: str, force: Callable[[Any], FloatArray], inputs: Sequence[Any], exact: FloatArray, note: str = ""
) -> Method:
    def error() -> float:
        return _error(np.array([force(x) for x in inputs]).reshape(exact.shape), exact)

    return Method(name, each(force, inputs), error, note, len(inputs))


def _error(found: FloatArray, exact: FloatArray) -> float:
    """The largest over grasps, relative to the largest force of each."""
    return float((np.abs(found - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))).max())
