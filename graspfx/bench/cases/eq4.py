"""Eq. (4): forces of all contacts from their points and displacements, over fingers and over conditioning."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.bench.case import Case, Method, each, is_installed, missing
from graspfx.bench.cases.contact_sets import ContactSet, contact_sets
from graspfx.bench.cases.eq4_fixed import fixed_case
from graspfx.bench.cases.eq4_many import many_case
from graspfx.bench.cases.eq4_methods import (
    EXTERNAL,
    INTERNAL,
    WRONG,
    Pair,
    force_method,
    load_machine_code,
    relative_error,
)
from graspfx.bench.oracles.exact import split_force
from graspfx.bench.peers.eq4_peers import PEERS, GraspMatrix, Project, closed_form
from graspfx.compile.kernel import kernel, source_function
from graspfx.compile.machine import compiled
from graspfx.compile.records import size_for
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.law import bilateral
from graspfx.coupling.rules import Rules
from graspfx.coupling.sample import resplit
from graspfx.grasp.direct import couple_points
from graspfx.grasp.point_coupling import PointCoupling
from graspfx.grasp.point_grasp import PointGrasp
from graspfx.objects import integrators as body

FloatArray = NDArray[np.float64]

FIXED = ("2 fingers", "5 fingers", "20 fingers", "100 fingers")

TITLE = "Eq. (4)"
LIMITS = """
Contacts change at every call, so that each method starts from points, but in the cases that say "contacts fixed".
"Grasp.split, Coupling.force" is the call `law.force(gx.Grasp(points).split(), e)`; a process runs its first contacts
interpreted, some milliseconds of them, then machine code if the cache has it. PointCoupling is made once, which
compiles for a second, once on a machine; "written and read" copies points and displacements into it and forces out of
it, "in place" leaves both out, for a loop that computes its points there. "Tick" and "direct kernel" are inside of the
framework: nobody calls them so. Peers build G about the origin, in place, and use their library's tolerance for the
rank, or what stands in for it; where 1 km or a line defeats that, a reader who centres the points first gets more
digits. Contacts nearer to a line than 1e-6 of their radius count as on it, 1e-12 in the cases of a given condition.
Equal weights, hard fingers in space, no damping.
"""


def cases(quick: bool) -> Iterator[Case]:
    """Compare methods on every set of contacts, then on some whose contacts are fixed, then on thousands at once."""
    sets = list(contact_sets(quick))
    for contacts in sets:
        pairs = list(zip(contacts.points, contacts.displacements, strict=True))
        exact = np.array([split_force(p, e, EXTERNAL, INTERNAL, contacts.tolerance) for p, e in pairs])
        methods = [*_ours(contacts, pairs, exact), *_peers(contacts, pairs, exact)]
        yield Case("eq4", contacts.name, "relative", methods, WRONG)
    for contacts in sets:
        if contacts.name in FIXED:
            yield fixed_case(contacts)
    yield many_case(quick)


def _peers(contacts: ContactSet, pairs: Sequence[Pair], exact: FloatArray) -> Iterator[Method]:
    matrix = GraspMatrix(contacts.points.shape[1])
    for name, project in PEERS.items():
        if name.startswith("scipy") and not is_installed("scipy"):
            yield missing(name, "scipy")
        else:
            yield force_method(name, _by(project, matrix), pairs, exact)

    def closed(pair: Pair) -> FloatArray:
        return INTERNAL * pair[1] + closed_form(pair[0], (EXTERNAL - INTERNAL) * pair[1])

    yield force_method("numpy, closed form", closed, pairs, exact, "no G: shift and turn about the centroid")


def _by(project: Project, matrix: GraspMatrix) -> Callable[[Pair], FloatArray]:
    def force(pair: Pair) -> FloatArray:
        e = pair[1].ravel()
        return INTERNAL * e + project(matrix(pair[0]), (EXTERNAL - INTERNAL) * e)

    return force


def _ours(contacts: ContactSet, pairs: Sequence[Pair], exact: FloatArray) -> Iterator[Method]:
    law = gx.Coupling(gx.Impedance(EXTERNAL), gx.Impedance(INTERNAL))

    def by_split(pair: Pair) -> FloatArray:
        return law.force(gx.Grasp(pair[0]).split(tolerance=contacts.tolerance), pair[1].ravel())

    load_machine_code()
    yield force_method("GraspFX Grasp.split, Coupling.force", by_split, pairs, exact)
    for engine in ("interpreted", "compiled"):
        yield from _direct(contacts, pairs, exact, law, engine)
    blocks, n = _blocks(law, contacts), contacts.points.shape[1]
    calls: list[Callable[[], object]] = [partial(source_function(sample), memoryview(block), 0) for block in blocks]
    yield _tick("GraspFX tick, interpreted", calls, blocks, n, exact)
    if not is_installed("llvmlite"):
        yield missing("GraspFX tick, compiled", "llvmlite")
        return
    yield _tick("GraspFX tick, compiled", [compiled(sample).bound(block, 0) for block in blocks], blocks, n, exact)


def _direct(
    contacts: ContactSet, pairs: Sequence[Pair], exact: FloatArray, law: gx.Coupling, engine: str
) -> Iterator[Method]:
    """Time the direct kernel, a call for each grasp and one call for all of them."""
    if engine == "compiled" and not is_installed("llvmlite"):
        yield missing("GraspFX PointCoupling, compiled", "llvmlite")
        return
    N, n, _ = contacts.points.shape
    own = [PointCoupling(law.external, law.internal, n, tolerance=contacts.tolerance, engine=engine) for _ in range(N)]
    for each_own, points, e in zip(own, contacts.points, contacts.displacements, strict=True):
        each_own.points[:], each_own.displacement[:] = points, e

    def force(one: PointCoupling) -> FloatArray:
        one.compute()
        return one.force

    def computed() -> float:
        return relative_error(np.array([force(one) for one in own]), exact)

    calls = each(lambda compute: compute(), [one.compute for one in own])
    yield Method(f"GraspFX PointCoupling, {engine}", calls, computed, "inputs in place", N)
    if engine == "interpreted":
        return

    def written(pair: Pair) -> FloatArray:
        one = own[0]
        one.points[:], one.displacement[:] = pair
        one.compute()
        return one.force.copy()

    yield force_method("GraspFX PointCoupling, compiled, written and read", written, pairs, exact)
    size = size_for(PointGrasp, count=n, dimensions=3)
    block = np.zeros((N, size))
    for row, points, e in zip(block, contacts.points, contacts.displacements, strict=True):
        grasp = PointGrasp(row)
        grasp.count, grasp.dimensions, grasp.tolerance = n, 3, contacts.tolerance
        grasp.external_stiffness, grasp.internal_stiffness = EXTERNAL, INTERNAL
        row[grasp.points.offset :][: 6 * n] = np.concatenate([points.ravel(), e.ravel()])
    run, flat = compiled(couple_all), block.ravel()

    def error() -> float:
        run(flat, N, size)
        return relative_error(block[:, size - 3 * n :].reshape(N, n, 3), exact)

    yield Method("GraspFX direct kernel, compiled", lambda: run(flat, N, size), error, calls=N)


@kernel
def couple_all(blocks: FloatArray, N: int, size: int) -> None:
    """Compute the forces of N blocks of one size from their points, in one call."""
    for k in range(N):
        couple_points(PointGrasp(blocks, k * size))


@kernel
def sample(grasp: GraspState) -> None:
    """Compute split and forces of one block, as a sample makes them once contacts have moved."""
    grasp.split_known = False
    resplit(grasp)
    bilateral(grasp, True, False)


def _blocks(law: gx.Coupling, contacts: ContactSet) -> list[FloatArray]:
    """Write the state block of a grasped object for every grasp."""
    n = contacts.points.shape[1]
    filled = []
    for points, e in zip(contacts.points, contacts.displacements, strict=True):
        arm = contacts.tolerance * float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum() / n))
        rules = Rules(attached=True, blend=(arm, arm))
        grasped = GraspedObject(n, 3, 0.001, law, rules, _free)
        grasped.array(FingerState.contact)[:] = points
        grasped.array(FingerState.displacement)[:, :3] = e
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
        forces = np.array([GraspState(block).fingers.array(FingerState.local) for block in blocks])
        return relative_error(forces[:, :, :3], exact)

    return Method(name, run, error, calls=len(calls))
