"""Forces and modes of point contacts on free objects by kernels, for one set of contacts or many in one call."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from threading import local
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.kernel import keep_lowerings, source_function
from graspfx.compile.lazy_kernels import KernelOnDemand
from graspfx.compile.records import size_for, start_of
from graspfx.grasp import direct, direct_modes
from graspfx.grasp.contact import MOMENTS
from graspfx.grasp.point_grasp import PointGrasp

FloatArray = NDArray[np.float64]
Space = TypeVar("Space")
Numbers = tuple[float, float, float, float]  # kep, ked, kip, kid

LOAD = 1_000  # number of contacts whose interpretation takes a tenth of the time to load machine code
COMPILE = 300_000  # number of contacts whose interpretation takes as long as compiling

COUPLE, COUPLE_ROWS, MODE_ROWS = (
    KernelOnDemand(kernel, load=LOAD, make=COMPILE)
    for kernel in (direct.couple, direct_modes.couple_rows, direct_modes.mode_rows)
)


def warm() -> None:
    """Load the kernels' machine code, or compile it.

    Raises:
        MissingPackageError: If LLVM is missing.
    """
    for kernel in (COUPLE, COUPLE_ROWS, MODE_ROWS):
        kernel.compile()


class Workspace:
    """Workspace of one thread for the forces of n contacts: a block, and the kernel that operates on it."""

    def __init__(self, n: int, d: int) -> None:
        self._contacts = n
        self._block = block = np.zeros(block_size(n, d))
        grasp = PointGrasp(block)
        self._head = block[: grasp.points.offset]
        self._points, self._displacement, self._rate, self._force = block[grasp.points.offset :].reshape(4, n * d)
        self._run: Callable[[], object] = partial(source_function(direct.couple), memoryview(block))
        self._compiled = self._moving = False
        self._unsaved = True
        self._last_head: FloatArray | None = None
        self._last_points: FloatArray | None = None

    def force(self, points: FloatArray, head: FloatArray, e: FloatArray, de: FloatArray | None) -> FloatArray:
        """Compute the forces (n d,). `points` must not be written to afterwards; see `point_force`."""
        if head is not self._last_head:
            self._head[:] = self._last_head = head
        if points is not self._last_points:
            self._points[:] = points.ravel()
            self._last_points = points
        self._displacement[:] = e
        if de is not None:
            self._rate[:], self._moving = de, True
        elif self._moving:
            self._rate[:], self._moving = 0.0, False
        if not self._compiled:
            machine = COUPLE.machine(self._contacts)
            if machine is not None:
                self._run, self._compiled = machine.bound(self._block), True
        self._run()
        if self._unsaved:
            keep_lowerings()  # stores the lowered kernels that were called
            self._unsaved = False
        return self._force.copy()


class ModeSpace:
    """Workspace of one thread for the modes of n contacts."""

    def __init__(self, n: int, d: int) -> None:
        self._contacts = n
        self._block = np.zeros(block_size(n, d))
        self._points, self._modes, self._ranks = np.zeros(n * d), np.zeros((d + MOMENTS[d], n * d)), np.zeros(1)
        self._arguments = self._block, 0, self._points, 0, self._modes.reshape(-1), 0, self._ranks, 0, 1
        self._run: Callable[[], object] | None = None

    def modes(self, points: FloatArray, head: FloatArray) -> tuple[FloatArray, int]:
        """Compute the modes (n d, rank) and the rank of one set of contacts; see `modes_of_one`."""
        self._block[: len(head)] = head
        self._points[:] = points.ravel()
        if self._run is None:
            machine = MODE_ROWS.machine(2 * self._contacts)
            if machine is not None:
                self._run = machine.bound(*self._arguments)
        if self._run is None:
            MODE_ROWS.interpret(*self._arguments)
        else:
            self._run()
        rank = int(self._ranks[0])
        return self._modes[:rank].T.copy(), rank


class Workspaces(local, Generic[Space]):
    """Workspaces of a thread, one for each number of contacts and dimension.

    Args:
        kind: Class of the workspace, constructed from (n, d).
    """

    def __init__(self, kind: Callable[[int, int], Space]) -> None:
        self._kind = kind
        self._by_size: dict[tuple[int, ...], Space] = {}

    def of(self, shape: tuple[int, ...]) -> Space:
        """Return the workspace for points (n, d)."""
        space = self._by_size.get(shape)
        if space is None:
            if len(self._by_size) >= MOST_WORKSPACES:
                self._by_size.clear()
            n, d = shape
            space = self._by_size[shape] = self._kind(n, d)
        return space


NO_GAINS = 0.0, 0.0, 0.0, 0.0
MOST_WORKSPACES = 64
FORCES, MODES = Workspaces(Workspace), Workspaces(ModeSpace)


def point_head(n: int, d: int, gains: Numbers, tolerance: float) -> FloatArray:
    """Return the first entries of a block: sizes, gains and tolerance; see `PointGrasp`."""
    size, places = _head_entries()
    head = np.zeros(size)
    head[places] = n, d, *gains, tolerance
    return head


@cache
def _head_entries() -> tuple[int, list[int]]:
    """Return the number of entries before a block's points, and the indices that `point_head` writes."""
    gains = "external_stiffness", "external_damping", "internal_stiffness", "internal_damping"
    return start_of(PointGrasp, "points"), [
        start_of(PointGrasp, n) for n in ("count", "dimensions", *gains, "tolerance")
    ]


@cache
def block_size(n: int, d: int) -> int:
    """Return the number of entries of a block of n contacts."""
    return size_for(PointGrasp, count=n, dimensions=d)


def point_force(points: FloatArray, head: FloatArray, e: FloatArray, de: FloatArray | None) -> FloatArray:
    """Compute the forces of eq. (4) for one set of point contacts, (n d,) [N].

    Args:
        points: Contact points, (n, d), read-only [m].
        head: Result of `point_head`.
        e, de: Displacements and rates, (n d,); a rate of None is zero.
    """
    return FORCES.of(points.shape).force(points, head, e, de)


def point_forces(points: FloatArray, head: FloatArray, e: FloatArray, de: FloatArray | None) -> FloatArray:
    """Compute forces (N, n d) of N sets of point contacts (N, n, d), bit-identical to those of `point_force`."""
    N, n, d = points.shape
    block = np.zeros(block_size(n, d))
    block[: len(head)] = head
    rate = np.zeros(N * n * d) if de is None else _flat(de)
    force = np.empty(N * n * d)
    COUPLE_ROWS.runner(N * n)(block, 0, _flat(points), 0, _flat(e), 0, rate, 0, force, 0, N)
    return force.reshape(N, n * d)


def modes_of_one(points: FloatArray, tolerance: float) -> tuple[FloatArray, int]:
    """Compute the orthonormal rigid modes (n d, rank) of one set of point contacts (n, d), and the rank."""
    n, d = points.shape
    return MODES.of(points.shape).modes(points, point_head(n, d, NO_GAINS, tolerance))


def point_modes(points: FloatArray, tolerance: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """Compute the orthonormal rigid modes and ranks of N sets of point contacts (N, n, d).

    Returns:
        Modes as rows (N, w, n d), translations before rotations, zero beyond a set's rank; and ranks (N,).
    """
    N, n, d = points.shape
    block = np.zeros(block_size(n, d))
    head = point_head(n, d, NO_GAINS, tolerance)
    block[: len(head)] = head
    modes, ranks = np.zeros((N, d + MOMENTS[d], n * d)), np.zeros(N)
    MODE_ROWS.runner(2 * N * n)(block, 0, _flat(points), 0, modes.reshape(-1), 0, ranks, 0, N)
    return modes, ranks.astype(np.int64)


def _flat(x: FloatArray) -> FloatArray:
    """Flatten an array; copy it if a kernel does not support its memory layout."""
    return np.require(x, requirements=["C", "W"]).reshape(-1)
