"""Forces and modes of point contacts on free objects by kernels, for one set of contacts or many in one call."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from threading import local
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.lazy_kernels import KernelOnDemand
from graspfx.compile.records import entries_of, size_for
from graspfx.grasp import direct
from graspfx.grasp.contact import MOMENTS
from graspfx.grasp.direct import PointGrasp

FloatArray = NDArray[np.float64]
Numbers = tuple[float, float, float, float]  # kep, ked, kip, kid

NO_GAINS = 0.0, 0.0, 0.0, 0.0
MOST_WORKSPACES = 64

LOAD = 1_000  # number of contacts whose interpretation takes a tenth of the time to load machine code
COMPILE = 300_000  # number of contacts whose interpretation takes as long as compiling

COUPLE, COUPLE_ROWS, MODE_ROWS = (
    KernelOnDemand(kernel, load=LOAD, make=COMPILE) for kernel in (direct.couple, direct.couple_rows, direct.mode_rows)
)


def warm() -> None:
    """Load the kernels' machine code, or compile it.

    Raises:
        MissingPackageError: If LLVM is missing.
    """
    for kernel in (COUPLE, COUPLE_ROWS, MODE_ROWS):
        kernel.compile()


class Workspace:
    """Workspace of one thread for n contacts: a block, the kernels that operate on it, and the modes."""

    def __init__(self, n: int, d: int) -> None:
        self._contacts = n
        self._block = block = new_block(n, d, NO_GAINS, 0.0)
        o = PointGrasp(block).points.offset
        self._points, self._displacement, self._rate, self._force = block[o:].reshape(4, n * d)
        self._given, self._modes, self._ranks = np.zeros(n * d), np.zeros((d + MOMENTS[d], n * d)), np.zeros(1)
        self._of_modes = block, 0, self._given, 0, self._modes.reshape(-1), 0, self._ranks, 0, 1
        self._bound: dict[KernelOnDemand, Callable[[], object]] = {}
        self._last_points: FloatArray | None = None
        self._gains, self._tolerance, self._moving = NO_GAINS, 0.0, False

    def force(
        self, points: FloatArray, gains: Numbers, tolerance: float, e: FloatArray, de: FloatArray | None
    ) -> FloatArray:
        """Compute the forces (n d,). `points` must not be written to afterwards; see `point_force`."""
        self._set(gains, tolerance)
        if points is not self._last_points:
            self._points[:] = points.ravel()
            self._last_points = points
        self._displacement[:] = e
        if de is not None:
            self._rate[:], self._moving = de, True
        elif self._moving:
            self._rate[:], self._moving = 0.0, False
        self._run(COUPLE, self._contacts, self._block)
        return self._force.copy()

    def modes(self, points: FloatArray, tolerance: float) -> tuple[FloatArray, int]:
        """Compute the modes (n d, rank) and the rank of one set of contacts; see `modes_of_one`."""
        self._set(self._gains, tolerance)
        self._given[:] = points.ravel()
        self._last_points = None  # the kernel overwrites the points in the block
        self._run(MODE_ROWS, 2 * self._contacts, *self._of_modes)
        rank = int(self._ranks[0])
        return self._modes[:rank].T.copy(), rank

    def _set(self, gains: Numbers, tolerance: float) -> None:
        """Write gains and tolerance to the block, if they differ from those of the last call."""
        if gains is not self._gains or tolerance != self._tolerance:
            self._block[_head_entries()[2:]] = *gains, tolerance
            self._gains, self._tolerance = gains, tolerance

    def _run(self, kernel: KernelOnDemand, work: int, *arguments: Any) -> None:
        """Run a kernel, which is always called with the same arguments."""
        run = self._bound.get(kernel)
        if run is None:
            machine = kernel.machine(work)
            if machine is None:
                kernel.interpret(*arguments)
                return
            run = self._bound[kernel] = machine.bound(*arguments)
        run()


class Workspaces(local):
    """Workspaces of a thread, one for each number of contacts and dimension."""

    def __init__(self) -> None:
        self._by_size: dict[tuple[int, ...], Workspace] = {}

    def of(self, points: FloatArray) -> Workspace:
        """Return the workspace for points (n, d)."""
        space = self._by_size.get(points.shape)
        if space is None:
            if len(self._by_size) >= MOST_WORKSPACES:
                self._by_size.clear()
            space = self._by_size[points.shape] = Workspace(*points.shape)
        return space


SPACES = Workspaces()


@cache
def _head_entries() -> list[int]:
    """List the entries of a block's sizes, gains and tolerance."""
    gains = "external_stiffness", "external_damping", "internal_stiffness", "internal_damping"
    return entries_of(PointGrasp, "count", "dimensions", *gains, "tolerance")


def new_block(n: int, d: int, gains: Numbers, tolerance: float) -> FloatArray:
    """Create a block for n contacts."""
    block = np.zeros(size_for(PointGrasp, count=n, dimensions=d))
    block[_head_entries()] = n, d, *gains, tolerance
    return block


def point_force(
    points: FloatArray, gains: Numbers, tolerance: float, e: FloatArray, de: FloatArray | None
) -> FloatArray:
    """Compute the forces of eq. (4) for one set of point contacts, (n d,) [N].

    Args:
        points: Contact points, (n, d), read-only [m].
        gains: Gains kep, ked, kip and kid [N/m, N s/m].
        tolerance: Relative tolerance of the rank.
        e, de: Displacements [m] and rates [m/s], (n d,); a rate of None is zero.
    """
    return SPACES.of(points).force(points, gains, tolerance, e, de)


def point_forces(
    points: FloatArray, gains: Numbers, tolerance: float, e: FloatArray, de: FloatArray | None
) -> FloatArray:
    """Compute forces (N, n d) of N sets of point contacts (N, n, d), bit-identical to those of `point_force`."""
    N, n, d = points.shape
    rate = np.zeros(N * n * d) if de is None else _flat(de)
    force = np.empty(N * n * d)
    block = new_block(n, d, gains, tolerance)
    COUPLE_ROWS.runner(N * n)(block, 0, _flat(points), 0, _flat(e), 0, rate, 0, force, 0, N)
    return force.reshape(N, n * d)


def modes_of_one(points: FloatArray, tolerance: float) -> tuple[FloatArray, int]:
    """Compute the orthonormal rigid modes (n d, rank) of one set of point contacts (n, d), and the rank."""
    return SPACES.of(points).modes(points, tolerance)


def point_modes(points: FloatArray, tolerance: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """Compute the orthonormal rigid modes and ranks of N sets of point contacts (N, n, d).

    Returns:
        Modes as rows (N, w, n d), translations before rotations, zero beyond a set's rank; and ranks (N,).
    """
    N, n, d = points.shape
    modes, ranks = np.zeros((N, d + MOMENTS[d], n * d)), np.zeros(N)
    block = new_block(n, d, NO_GAINS, tolerance)
    MODE_ROWS.runner(2 * N * n)(block, 0, _flat(points), 0, modes.reshape(-1), 0, ranks, 0, N)
    return modes, ranks.astype(np.int64)


def _flat(x: FloatArray) -> FloatArray:
    """Flatten an array; copy it if a kernel does not support its memory layout."""
    return np.require(x, requirements=["C", "W"]).reshape(-1)
