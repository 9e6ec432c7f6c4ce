"""Point contacts on free objects by kernels: forces and modes of one set of contacts, or of thousands in one call.

A kernel runs interpreted until its machine code is worth loading, and until it is worth compiling; that is decided by
how much was computed and by what the cache holds, never by a clock, and both give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial
from importlib.util import find_spec
from threading import local
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.footprints import was_compiled
from graspfx.compile.kernel import keep_lowerings, source_function
from graspfx.compile.records import size_for, start_of
from graspfx.grasp import direct, direct_modes
from graspfx.grasp.contact import MOMENTS
from graspfx.grasp.point_grasp import PointGrasp

if TYPE_CHECKING:
    from graspfx.compile.machine import Machine

FloatArray = NDArray[np.float64]
Numbers = tuple[float, float, float, float]  # kep, ked, kip, kid

LOAD = 1_000  # contacts: interpreted, they take some milliseconds; to load machine code takes ten times as long
COMPILE = 300_000  # contacts that take as long as compiling


class Engine:
    """A kernel, interpreted or as machine code.

    Args:
        kernel: the function.
    """

    def __init__(self, kernel: Callable[..., object]) -> None:
        self.kernel = kernel
        self._work = 0
        self._next: float = LOAD
        self._machine: Machine | None = None

    @property
    def is_compiled(self) -> bool:
        """Whether the machine code is loaded."""
        return self._machine is not None

    def machine(self, contacts: int) -> Machine | None:
        """Give the machine code for so many contacts more, or None where they are to be interpreted."""
        if self._machine is None:
            self._work += contacts
            if self._work >= self._next:
                self._load()
        return self._machine

    def _load(self) -> None:
        if find_spec("llvmlite") is None:
            self._next = math.inf
            return
        make = self._work >= COMPILE
        if make or was_compiled(self.kernel):
            from graspfx.compile.machine import compiled  # takes as long to import as thousands of interpreted calls

            try:
                self._machine = compiled(self.kernel, make=make)
                return
            except LookupError:
                pass
        self._next = COMPILE

    def call(self, contacts: int, *arguments: Any) -> None:
        """Run the kernel on arrays and numbers; each record and group of numbers is an array and an offset."""
        machine = self.machine(contacts)
        if machine is not None:
            machine.once(*arguments)
            return
        self.interpret(*arguments)

    def interpret(self, *arguments: Any) -> None:
        """Run the kernel as it stands."""
        views = (memoryview(a) if isinstance(a, np.ndarray) else a for a in arguments)  # quicker to read than arrays
        source_function(self.kernel)(*views)
        keep_lowerings()


COUPLE = Engine(direct.couple)
COUPLE_ROWS = Engine(direct_modes.couple_rows)
MODE_ROWS = Engine(direct_modes.mode_rows)


def warm() -> None:
    """Compile the kernels, unless they are in the cache.

    Raises:
        MissingPackageError: no LLVM.
    """
    from graspfx.compile.machine import compiled

    for engine in (COUPLE, COUPLE_ROWS, MODE_ROWS):
        compiled(engine.kernel)


class Workspace:
    """Workspace of one thread for the forces of n contacts: a block that stays, with the kernel bound to it."""

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
        """Compute the forces (n d,) from points that nobody writes to; see `point_force`."""
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
            keep_lowerings()  # of kernels that were called
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
        """Compute the modes (n d, rank) of one set of contacts, and the rank; see `modes_of_one`."""
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


class Workspaces(local):
    """Workspaces of a thread, by number of contacts and dimensions."""

    def __init__(self) -> None:
        self.by_size: dict[tuple[int, int], Workspace] = {}
        self.of_modes: dict[tuple[int, int], ModeSpace] = {}


NO_GAINS = 0.0, 0.0, 0.0, 0.0
MOST_WORKSPACES = 64
WORKSPACES = Workspaces()


def point_head(n: int, d: int, gains: Numbers, tolerance: float) -> FloatArray:
    """Make the first entries of a block: sizes, gains and tolerance; see `PointGrasp`."""
    size, places = _head_entries()
    head = np.zeros(size)
    head[places] = n, d, *gains, tolerance
    return head


@cache
def _head_entries() -> tuple[int, list[int]]:
    """Give the number of entries before a block's points, and those that `point_head` writes."""
    gains = "external_stiffness", "external_damping", "internal_stiffness", "internal_damping"
    return start_of(PointGrasp, "points"), [
        start_of(PointGrasp, n) for n in ("count", "dimensions", *gains, "tolerance")
    ]


@cache
def block_size(n: int, d: int) -> int:
    """Count the entries of a block of n contacts."""
    return size_for(PointGrasp, count=n, dimensions=d)


def point_force(points: FloatArray, head: FloatArray, e: FloatArray, de: FloatArray | None) -> FloatArray:
    """Compute forces of eq. (4) on one set of point contacts, (n d,) [N].

    Args:
        points: (n, d), read-only [m].
        head: of `point_head`.
        e, de: displacements and rates, (n d,); a rate of None is zero.
    """
    spaces = WORKSPACES.by_size
    space = spaces.get(points.shape)
    if space is None:
        if len(spaces) >= MOST_WORKSPACES:
            spaces.clear()
        space = spaces[points.shape] = Workspace(*points.shape)
    return space.force(points, head, e, de)


def point_forces(points: FloatArray, head: FloatArray, e: FloatArray, de: FloatArray | None) -> FloatArray:
    """Compute forces (N, n d) of N sets of point contacts (N, n, d), each as `point_force` does, to the bit."""
    N, n, d = points.shape
    block = np.zeros(block_size(n, d))
    block[: len(head)] = head
    rate = np.zeros(N * n * d) if de is None else _flat(de)
    force = np.empty(N * n * d)
    COUPLE_ROWS.call(N * n, block, 0, _flat(points), 0, _flat(e), 0, rate, 0, force, 0, N)
    return force.reshape(N, n * d)


def modes_of_one(points: FloatArray, tolerance: float) -> tuple[FloatArray, int]:
    """Compute orthonormal rigid modes of one set of point contacts (n, d): (n d, rank), and the rank."""
    spaces = WORKSPACES.of_modes
    space = spaces.get(points.shape)
    if space is None:
        if len(spaces) >= MOST_WORKSPACES:
            spaces.clear()
        space = spaces[points.shape] = ModeSpace(*points.shape)
    n, d = points.shape
    return space.modes(points, point_head(n, d, NO_GAINS, tolerance))


def point_modes(points: FloatArray, tolerance: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """Compute orthonormal rigid modes of N sets of point contacts (N, n, d), and ranks.

    Returns:
        Rows (N, w, n d): translations, then rotations; those beyond a set's rank are zero. Ranks (N,).
    """
    N, n, d = points.shape
    block = np.zeros(block_size(n, d))
    head = point_head(n, d, NO_GAINS, tolerance)
    block[: len(head)] = head
    modes, ranks = np.zeros((N, d + MOMENTS[d], n * d)), np.zeros(N)
    MODE_ROWS.call(2 * N * n, block, 0, _flat(points), 0, modes.reshape(-1), 0, ranks, 0, N)
    return modes, ranks.astype(np.int64)


def _flat(x: FloatArray) -> FloatArray:
    """Flatten an array, copied where a kernel could not take it as it is."""
    return np.require(x, requirements=["C", "W"]).reshape(-1)
