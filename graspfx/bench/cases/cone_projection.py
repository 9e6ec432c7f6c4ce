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
from graspfx.compile.machine import compiled
from graspfx.cones.complement import complement, release, settle
from graspfx.cones.cone import modes_offset
from graspfx.cones.friction import friction_force, friction_force_square, problem_size

FloatArray = NDArray[np.float64]

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
MODES = 6


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
    kernel = compiled(gauss_seidel) if is_installed("llvmlite") else gauss_seidel
    theta = 0.0 if kind.law == "coulomb" else 1.0
    m, N = 3 * kind.fingers, len(kind.members)
    blocks = np.array([np.concatenate([p.W.ravel(), p.e, np.zeros(m)]) for p in kind.members])
    flat = blocks.ravel()
    for tolerance in TOLERANCES:

        def call(tolerance: float = tolerance) -> None:
            if kernel(flat, N, blocks.shape[1], m, kind.friction, theta, tolerance) == SWEEPS:
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


def _ours(kind: Problems) -> Iterator[Method]:
    n = kind.fingers
    if kind.law != "associated":
        normals = np.eye(3)[None, 0].repeat(n, axis=0)
        yield _method("GraspFX unilateral_force", kind, partial(_unilateral, normals, kind.friction))
    by_modes = 1 if kind.law == "frictionless" else 3  # coordinates per finger that the tick asks for
    if kind.law == "frictionless":
        yield from _both("GraspFX pivoting", pivot_all, *_pivoting(kind), (n,), kind, 3)
    else:
        coulomb = kind.law == "coulomb"
        yield from _both("GraspFX Newton", newton_all, *_square(kind), (n, coulomb), kind, 3)
    more = (n, by_modes, kind.external, INTERNAL, kind.law == "coulomb")
    yield from _both("GraspFX Newton in modes", modes_all, *_modes(kind, by_modes, 0.0), more, kind, by_modes)
    if is_installed("llvmlite"):
        block, force = _modes(kind, by_modes, 0.01)
        warm = compiled(modes_all)
        yield _kernel("GraspFX Newton in modes, compiled, warm", warm, block, block, force, more, kind, by_modes)


def _unilateral(normals: FloatArray, mu: float, p: Problem) -> FloatArray:
    return gx.unilateral_force(p.K, p.e, normals, mu).force


def _both(
    name: str, kernel: Callable[..., None], block: FloatArray, force: int, more: Sequence[Any], kind: Problems, d: int
) -> Iterator[Method]:
    yield _kernel(f"{name}, interpreted", kernel, memoryview(block.ravel()), block, force, more, kind, d)
    if is_installed("llvmlite"):
        yield _kernel(f"{name}, compiled", compiled(kernel), block.copy(), None, force, more, kind, d)
    else:
        yield missing(f"{name}, compiled", "llvmlite")


def _kernel(
    name: str, kernel: Callable[..., None], S: Any, block: FloatArray | None, force: int, more: Sequence[Any],
    kind: Problems, d: int,
) -> Method:  # fmt: skip
    """Make a kernel for all problems of a kind: a block each, N of one size, with the answers from `force` on."""
    blocks: FloatArray = S if block is None else block
    N, size = blocks.shape
    flat = S.ravel() if isinstance(S, np.ndarray) else S

    def call() -> None:
        kernel(flat, N, size, *more)

    def error() -> float:
        call()
        answers = np.zeros((N, kind.fingers, 3))
        answers[:, :, :d] = blocks[:, force : force + kind.fingers * d].reshape(N, kind.fingers, d)
        return _error(answers.reshape(N, -1), kind)

    return Method(name, call, error, calls=N)


def modes_all(S: Any, N: int, size: int, n: int, d: int, external: float, internal: float, coulomb: bool) -> None:
    """Solve by `friction_force` from the unknowns that stand at the end of each block."""
    for k in range(N):
        o = k * size
        for j in range(MODES):
            S[o + 3 * n + 5 * n * d + j] = S[o + size - MODES + j]
        friction_force(S, o, n, d, MODES, external, internal, coulomb, RESTARTS)


def newton_all(S: Any, N: int, size: int, n: int, coulomb: bool) -> None:
    """Solve by `friction_force_square` from zero."""
    m = 3 * n
    for k in range(N):
        o = k * size
        for j in range(m):
            S[o + 3 * n + 5 * m + j] = 0.0
        friction_force_square(S, o, n, 3, o + size - m * m, m, True, coulomb, RESTARTS)


def pivot_all(S: Any, N: int, size: int, n: int) -> None:
    """Solve by principal pivoting, for blocks of K, e, then room for what `unilateral_force` needs."""
    m = 3 * n
    for k in range(N):
        K = k * size
        e = K + m * m
        vector, diagonal, marks, state, square = e + m, e + 2 * m, e + 3 * m, e + 4 * m, e + 4 * m + n
        scale = 0.0
        for p in range(m):
            total = 0.0
            for q in range(m):
                S[square + p * m + q] = S[K + p * m + q]
                total += S[K + p * m + q] * S[e + q]
            S[vector + p], S[diagonal + p] = total, S[K + p * m + p]
            S[marks + p] = 1.0 if p % 3 else 0.0
        for i in range(n):
            S[state + i] = 1.0
        release(S, square, m, vector, m, m, marks, diagonal)
        for p in range(m):
            scale = max(scale, abs(S[vector + p]))
        complement(S, square, m, vector, m, n, 3, False, True, state, diagonal, scale)
        settle(S, square, m, vector, e, n, 3, False, state)


def _pivoting(kind: Problems) -> tuple[FloatArray, int]:
    m = 3 * kind.fingers
    room = np.zeros(3 * m + kind.fingers + m * m)
    return np.array([np.concatenate([p.K.ravel(), p.e, room]) for p in kind.members]), m * m + m


def _square(kind: Problems) -> tuple[FloatArray, int]:
    n, m = kind.fingers, 3 * kind.fingers
    blocks = np.zeros((len(kind.members), problem_size(n, 3, m, True) + m * m))
    for block, p in zip(blocks, kind.members, strict=True):
        block[n : 2 * n] = kind.friction
        block[3 * n : 3 * n + m] = p.e
        block[-m * m :] = p.K.ravel()
    return blocks, 3 * n + 2 * m


def _modes(kind: Problems, d: int, off: float) -> tuple[FloatArray, int]:
    """Write blocks for `modes_all`; with `off` they start from the answer for displacements that are off by so much."""
    n, m = kind.fingers, kind.fingers * d
    blocks = np.zeros((len(kind.members), problem_size(n, d, MODES, False) + MODES))
    rng = np.random.default_rng(1)
    modes, unknowns = modes_offset(0, n, d, MODES), 3 * n + 5 * m
    for block, p in zip(blocks, kind.members, strict=True):
        e = p.e.reshape(n, 3)[:, :d].ravel()
        block[:n] = 1.0
        block[n : 2 * n] = kind.friction
        table = block[modes : modes + MODES * (1 + m)].reshape(MODES, 1 + m)
        count = p.Q.shape[1]
        table[:count, 0] = 1.0
        table[:count, 1:] = p.Q.T.reshape(count, n, 3)[:, :, :d].reshape(count, m)
        if off:
            block[3 * n : 3 * n + m] = e * (1.0 + off * rng.normal(size=m))
            friction_force(
                memoryview(block), 0, n, d, MODES, kind.external, INTERNAL, kind.law == "coulomb", RESTARTS
            )  # fmt: skip
            block[-MODES:] = block[unknowns : unknowns + MODES]
        block[3 * n : 3 * n + m] = e
    return blocks, 3 * n + 2 * m


def _error(forces: Sequence[FloatArray] | FloatArray, kind: Problems) -> float:
    """Find the largest error over problems, relative to the largest force of each."""
    exact = np.array([p.force for p in kind.members])
    return float((np.abs(np.array(forces) - exact).max(axis=1) / np.abs(exact).max(axis=1)).max())
