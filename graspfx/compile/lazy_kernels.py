"""Kernels that are interpreted at first, and compiled when enough work is expected.

The decision depends on the amount of work and on the contents of the cache, but not on measured times. Interpreted and
compiled kernels return identical results.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from graspfx.compile.kernel import keep_lowerings, source_function
from graspfx.compile.own_sources import was_compiled
from graspfx.errors import GraspFXError

if TYPE_CHECKING:
    from graspfx.compile.machine import Machine


class KernelOnDemand:
    """Kernel that is interpreted until it has done a certain amount of work, and then runs as machine code.

    The caller states the work of each use, in a unit of its choice; the amounts are added.

    Args:
        kernel: Kernel function.
        load: Total work at which machine code is loaded if the cache contains it.
        make: Total work at which the kernel is compiled if the cache does not contain its machine code.
    """

    def __init__(self, kernel: Callable[..., object], *, load: float, make: float) -> None:
        self.kernel = kernel
        self._load, self._make = load, make
        self._work, self._tried = 0.0, False
        self._machine: Machine | None = None

    @property
    def is_compiled(self) -> bool:
        """Whether the machine code is loaded."""
        return self._machine is not None

    def machine(self, work: float) -> Machine | None:
        """Add `work` to the total work; return the machine code, or None if the kernel must be interpreted."""
        if self._machine is None:
            self._work += work
            least = self._make if self._tried else self._load
            if self._work >= least:
                self._take()
        return self._machine

    def runner(self, work: float) -> Callable[..., object]:
        """Add `work` to the total work, and return a function that runs the kernel, as machine code or interpreted.

        The function takes the arguments of the lowered kernel; buffers are arrays.
        """
        machine = self.machine(work)
        return self.interpret if machine is None else machine.once

    def interpret(self, *arguments: Any) -> None:
        """Interpret the kernel once, with the arguments of the lowered kernel."""
        views = (memoryview(a) if isinstance(a, np.ndarray) else a for a in arguments)  # quicker to read than arrays
        source_function(self.kernel)(*views)
        keep_lowerings()

    def compile(self) -> None:
        """Load the machine code of the kernel from the cache, or compile the kernel.

        Raises:
            MissingPackageError: If LLVM is not installed.
        """
        from graspfx.compile.machine import compiled

        self._machine = compiled(self.kernel)

    def _take(self) -> None:
        """Load the machine code of the kernel if it is in the cache; compile the kernel if the total work permits."""
        self._tried = True
        make = self._work >= self._make
        if make or was_compiled(self.kernel):
            from graspfx.compile.machine import compiled  # its import takes as long as thousands of interpreted calls

            try:
                self._machine = compiled(self.kernel, make=make)
            except LookupError:
                pass
            except GraspFXError:  # LLVM is missing or does not load
                self._make = math.inf
