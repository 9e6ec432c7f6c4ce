"""Kernels that are interpreted until loading or compiling their machine code saves time.

The decision depends on the amount of work and the contents of the cache, never on a clock. Both alternatives return the
same bits.
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
    """A kernel, interpreted or as machine code.

    Work is counted over all calls in units of the caller's choice.

    Args:
        kernel: Kernel function.
        load: Work from which on cached machine code is used.
        make: Work whose interpretation takes as long as compiling; from then on the kernel is compiled.
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
        """Return the machine code for further `work`, or None if the work is to be interpreted."""
        if self._machine is None:
            self._work += work
            least = self._make if self._tried else self._load
            if self._work >= least:
                self._take()
        return self._machine

    def runner(self, work: float) -> Callable[..., object]:
        """Return the function that runs the kernel for further `work`, in any number of calls.

        The function's arguments are arrays and numbers; each record and group of numbers is an array and an offset.
        """
        machine = self.machine(work)
        return self.interpret if machine is None else machine.once

    def interpret(self, *arguments: Any) -> None:
        """Run the kernel in Python's interpreter."""
        views = (memoryview(a) if isinstance(a, np.ndarray) else a for a in arguments)  # quicker to read than arrays
        source_function(self.kernel)(*views)
        keep_lowerings()

    def compile(self) -> None:
        """Load the machine code, or compile it.

        Raises:
            MissingPackageError: If LLVM is not installed.
        """
        from graspfx.compile.machine import compiled

        self._machine = compiled(self.kernel)

    def _take(self) -> None:
        """Load the machine code, or compile it, if this already saves time."""
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
