"""Forces in cones: what fingers do that can only push, without friction and with a coefficient."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import graspfx as gx
from graspfx.bench.case import Case, Method, each, is_installed, missing
from graspfx.bench.cases.cone_problems import INTERNAL, Problem, Problems, problems
from graspfx.bench.peers.projection_peers import SWEEPS, ByClarabel, gauss_seidel
from graspfx.compile.kernel import kernel, source_function
from graspfx.compile.machine import compiled
from graspfx.compile.records import Floats, Many, Record, Table, floats, size_for, start_of, table
from graspfx.cones.complement import Contacts, complement, release, settle
from graspfx.cones.friction import friction_force, friction_force_square
from graspfx.cones.problem import (
    MODES,
    ConeContact,
    FrictionProblem,
    Gains,
    ModePart,
    Unknown,
    problem_size,
    set_up,
)

FloatArray = NDArray[np.float64]
Posed = tuple[Callable[..., Any], tuple[Any, ...], FloatArray]  # a kernel, its arguments, and where its forces stand

TITLE = "Forces in cones"
LIMITS = """
Given are K, its inverse and e in contact frames: clarabel and Gauss-Seidel need the inverse, the others K. Clarabel's
solver is made once and given new numbers at each call; Gauss-Seidel is compiled where llvmlite is installed. "GraspFX
unilateral_force" is the public call, in Python; the other rows of ours are kernels of the tick, which nobody calls by
themselves. "In modes" is what a tick does with numbers for gains: it is given the rigid motions instead of K; "warm"
starts from the answer for displacements that differ by 1 %, all others from zero. Coulomb's law has no convex problem,
so clarabel is not there; problems for which no Coulomb answer was found are left out, so that failures do not show.
"""

TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
RESTARTS = 2
WRONG = 0.1  # of the largest force


def cases(quick: bool) -> Iterator[Case]:
    for kind in problems(quick):
        name = f"{kind.law}, {kind.fingers} fingers, gains' ratio {kind.ratio:g}"
        yield Case("projection", name, "relative", [*_ours(kind), *_clarabel(kind), *_gauss_seidel(kind)], WRONG)


# Peers ------------------------------------------------------------------------------------------------------------


def _clarabel(kind: Problems) -> Iterator[Method]:
    if kind.law == "coulomb":
        return
    for tolerance in (1e-8, 1e-12):
        name = f"clarabel to {tolerance:.0e}"
        if is_installed("clarabel"):
            solver = ByClarabel(3 * kind.fingers, kind.friction, tolerance)
            yield _method(name, kind, partial(_by_clarabel, solver))
        else:
            yield missing(name, "clarabel")


def _by_clarabel(solver: ByClarabel, p: Problem) -> FloatArray:
    return solver(p.W, p.e)


def _gauss_seidel(kind: Problems) -> Iterator[Method]:
    sweeps: Any = compiled(gauss_seidel) if is_installed("llvmlite") else gauss_seidel
    theta = 0.0 if kind.law == "coulomb" else 1.0
    m, N = 3 * kind.fingers, len(kind.members)
    blocks = np.array([np.concatenate([[m], p.W.ravel(), p.e, np.zeros(m)]) for p in kind.members])
    flat = blocks.ravel()
    for tolerance in TOLERANCES:

        def call(tolerance: float = tolerance) -> None:
            if sweeps(flat, 0, blocks.shape[1], N, kind.friction, theta, tolerance) == SWEEPS:
                raise RuntimeError(f"not done after {SWEEPS} sweeps")

        def error(call: Callable[[], None] = call) -> float:
            call()
            return _error(blocks[:, -m:], kind)

        yield Method(f"Gauss-Seidel to {tolerance:.0e}", call, error, calls=N)


def _method(name: str, kind: Problems, force: Callable[[Problem], FloatArray]) -> Method:
    def error() -> float:
        return _error([force(p) for p in kind.members], kind)

    return Method(name, each(force, kind.members), error, calls=len(kind.members))


# Ours -------------------------------------------------------------------------------------------------------------


class Square(Record):
    """A matrix K of `size` rows."""

    size: int
    entries: Table = table("size", "size")


class Pivoting(Record):
    """A problem of pushes without friction: K and e of `count` fingers, and room for the search."""

    count: int
    size: int
    stiffness: Table = table("size", "size")
    displacement: Floats = floats("size")
    vector: Floats = floats("size")
    diagonal: Floats = floats("size")
    marks: Floats = floats("size")
    state: Floats = floats("count")
    square: Table = table("size", "size")


def _ours(kind: Problems) -> Iterator[Method]:
    n = kind.fingers
    if kind.law != "associated":
        normals = np.eye(3)[None, 0].repeat(n, axis=0)
        yield _method("GraspFX unilateral_force", kind, partial(_unilateral, normals, kind.friction))
    by_modes = 1 if kind.law == "frictionless" else 3  # coordinates per finger that the tick asks for
    coulomb = kind.law == "coulomb"
    if kind.law == "frictionless":
        yield from _both("GraspFX pivoting", partial(_pivoting, kind), kind)
    else:
        yield from _both("GraspFX Newton", partial(_newton, kind, coulomb), kind)
    yield from _both("GraspFX Newton in modes", partial(_modes, kind, by_modes, coulomb, 0.0), kind)
    if is_installed("llvmlite"):
        run, arguments, force = _modes(kind, by_modes, coulomb, 0.01)
        yield _kernel("GraspFX Newton in modes, compiled, warm", compiled(run), arguments, force, kind)


def _both(name: str, pose: Callable[[], Posed], kind: Problems) -> Iterator[Method]:
    """Make a kernel that does all problems of a kind, interpreted and compiled."""
    run, arguments, force = pose()
    views = [memoryview(a) if isinstance(a, np.ndarray) else a for a in arguments]
    yield _kernel(f"{name}, interpreted", source_function(run), views, force, kind)
    if is_installed("llvmlite"):
        run, arguments, force = pose()
        yield _kernel(f"{name}, compiled", compiled(run), arguments, force, kind)
    else:
        yield missing(f"{name}, compiled", "llvmlite")


def _kernel(name: str, run: Callable[..., Any], arguments: Sequence[Any], force: FloatArray, kind: Problems) -> Method:
    """Make a kernel for all problems of a kind, whose forces (problems, fingers, coordinates) stand in `force`."""

    def call() -> None:
        run(*arguments)

    def error() -> float:
        call()
        answers = np.zeros((len(kind.members), kind.fingers, 3))
        answers[:, :, : force.shape[2]] = force
        return _error(answers.reshape(len(kind.members), -1), kind)

    return Method(name, call, error, calls=len(kind.members))


@kernel
def modes_all(
    problems: Many[FrictionProblem], starts: Table, d: int, gains: Gains, coulomb: bool, restarts: int
) -> None:
    """Ask each problem for `friction_force`, from its row of unknowns."""
    for k, problem in enumerate(problems):
        for j in range(MODES):
            problem.unknowns[j].value = starts[k, j]
        friction_force(problem, d, gains, coulomb, restarts)


@kernel
def newton_all(problems: Many[FrictionProblem], squares: Many[Square], coulomb: bool, restarts: int) -> None:
    """Ask each problem for `friction_force_square`, from zero."""
    for k, problem in enumerate(problems):
        square = squares[k]
        for j in range(square.size):
            problem.unknowns[j].value = 0.0
        friction_force_square(problem, 3, square.entries, True, coulomb, restarts)


@kernel
def pivot_all(problems: Many[Pivoting]) -> None:
    """Do what `unilateral_force` does for each problem, by principal pivoting."""
    for problem in problems:
        m = problem.size
        K, e, square, vector = problem.stiffness, problem.displacement, problem.square, problem.vector
        for p in range(m):
            total = 0.0
            for q in range(m):
                square[p, q] = K[p, q]
                total += K[p, q] * e[q]
            vector[p] = total
            problem.diagonal[p] = K[p, p]
            problem.marks[p] = 1.0 if p % 3 else 0.0
        for i in range(problem.count):
            problem.state[i] = 1.0
        release(square, vector, m, problem.marks, problem.diagonal)
        scale = 0.0
        for p in range(m):
            scale = max(scale, abs(vector[p]))
        contacts = Contacts(problem.count, 3, False)
        complement(square, vector, problem.diagonal, problem.state, contacts, True, scale)
        settle(square, vector, e, problem.state, contacts)


def _pivoting(kind: Problems) -> Posed:
    n, m, N = kind.fingers, 3 * kind.fingers, len(kind.members)
    size = size_for(Pivoting, count=n, size=m)
    blocks = np.zeros((N, size))
    for block, p in zip(blocks, kind.members, strict=True):
        problem = Pivoting(block)
        problem.count, problem.size = n, m
        first, last = problem.stiffness.offset, problem.vector.offset
        block[first:last] = [*p.K.ravel(), *p.e]
    start = Pivoting(blocks[0]).vector.offset
    return pivot_all, (blocks.ravel(), 0, size, N), blocks[:, start : start + m].reshape(N, n, 3)


def _newton(kind: Problems, coulomb: bool) -> Posed:
    m, N = 3 * kind.fingers, len(kind.members)
    blocks, force = _problems(kind, 3, m)
    squares = np.array([[m, *p.K.ravel()] for p in kind.members])
    places = (blocks.ravel(), 0, blocks.shape[1], N, squares.ravel(), 0, squares.shape[1], N)
    return newton_all, (*places, coulomb, RESTARTS), force


def _modes(kind: Problems, d: int, coulomb: bool, off: float) -> Posed:
    """Pose `modes_all`; with `off` from the answer for displacements that are off by so much."""
    blocks, force = _problems(kind, d, MODES)
    starts = np.zeros((len(blocks), MODES))
    gains = Gains(kind.external, INTERNAL)
    rng = np.random.default_rng(1)
    for k, p in enumerate(kind.members):
        problem = FrictionProblem(memoryview(blocks[k]))
        count = problem.modes = p.Q.shape[1]
        problem.contacts.array(ConeContact.weight)[:] = 1.0
        problem.unknowns.array(Unknown.share)[:count] = 1.0
        for i, contact in enumerate(problem.contacts):
            contact.modes.array(ModePart.motion)[:count, :d] = p.Q[3 * i : 3 * i + d].T
        if off:
            e = problem.contacts.array(ConeContact.displacement)[:, :d]
            exact = e.copy()
            e *= 1.0 + off * rng.normal(size=e.shape)
            friction_force(problem, d, gains, coulomb, RESTARTS)
            starts[k] = problem.unknowns.array(Unknown.value)
            e[:] = exact
    places = (blocks.ravel(), 0, blocks.shape[1], len(blocks), starts.ravel(), 0, MODES)
    return modes_all, (*places, d, gains.external, gains.internal, coulomb, RESTARTS), force


def _problems(kind: Problems, d: int, room: int) -> tuple[FloatArray, FloatArray]:
    """Pose blocks with a friction problem each; view their forces (problems, fingers, d)."""
    n = kind.fingers
    blocks = np.zeros((len(kind.members), problem_size(n, room)))
    for block, p in zip(blocks, kind.members, strict=True):
        contacts = set_up(block, 0, n, room).contacts
        contacts.array(ConeContact.coefficient)[:] = kind.friction
        contacts.array(ConeContact.displacement)[:, :d] = p.e.reshape(n, 3)[:, :d]
    contacts = FrictionProblem(blocks[0]).contacts
    rows = blocks[:, contacts.offset :].reshape(len(blocks), n, contacts.stride)
    first = start_of(ConeContact, "force")
    return blocks, rows[:, :, first : first + d]


def _unilateral(normals: FloatArray, mu: float, p: Problem) -> FloatArray:
    return gx.unilateral_force(p.K, p.e, normals, mu).force


def _error(forces: Sequence[FloatArray] | FloatArray, kind: Problems) -> float:
    """Find the largest error over problems, relative to the largest force of each."""
    exact = np.array([p.force for p in kind.members])
    return float((np.abs(np.array(forces) - exact).max(axis=1) / np.abs(exact).max(axis=1)).max())
