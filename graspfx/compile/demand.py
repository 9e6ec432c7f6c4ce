"""A kernel that is interpreted until its machine code is worth loading, and until it is worth compiling.

That is decided by how much was computed and by what the cache holds, never by a clock, and both give the same bits.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from graspfx.compile.footprints import was_compiled
from graspfx.compile.kernel import keep_lowerings, source_function
from graspfx.errors import GraspFXError

if TYPE_CHECKING:
    from graspfx.compile.machine import Machine


class KernelOnDemand:
    """A kernel, interpreted or as machine code.

    Work is counted in what the caller likes, over all calls.

    Args:
        kernel: the function.
        few: work from which machine code in the cache is taken where LLVM is there already.
        load: the same where LLVM would have to be loaded first.
        make: work that takes as long as compiling.
    """

    def __init__(self, kernel: Callable[..., object], *, few: float, load: float, make: float) -> None:
        self.kernel = kernel
        self._few, self._load, self._make = few, load, make
        self._work, self._tried = 0.0, False
        self._machine: Machine | None = None

    @property
    def is_compiled(self) -> bool:
        """Whether the machine code is loaded."""
        return self._machine is not None

    def machine(self, work: float) -> Machine | None:
        """Give the machine code for so much more work, or None where it is to be interpreted."""
        if self._machine is None:
            self._work += work
            least = self._make if self._tried else self._few if "llvmlite" in sys.modules else self._load
            if self._work >= least:
                self._take()
        return self._machine

    def runner(self, work: float) -> Callable[..., object]:
        """Choose who runs the kernel for so much more work, in any number of calls.

        Its arguments are arrays and numbers; each record and group of numbers is an array and an offset.
        """
        machine = self.machine(work)
        return self.interpret if machine is None else machine.once

    def interpret(self, *arguments: Any) -> None:
        """Run the kernel as it stands."""
        views = (memoryview(a) if isinstance(a, np.ndarray) else a for a in arguments)  # quicker to read than arrays
        source_function(self.kernel)(*views)
        keep_lowerings()

    def compile(self) -> None:
        """Compile the kernel, unless it is in the cache.

        Raises:
            MissingPackageError: no LLVM.
        """
        from graspfx.compile.machine import compiled

        compiled(self.kernel)

    def _take(self) -> None:
        """Load the machine code, or compile it; leave the kernel to Python where that is not worth it yet."""
        self._tried = True
        make = self._work >= self._make
        if make or was_compiled(self.kernel):
            from graspfx.compile.machine import compiled  # takes as long to import as thousands of interpreted calls

            try:
                self._machine = compiled(self.kernel, make=make)
            except LookupError:
                pass
            except GraspFXError:  # no LLVM, or one that does not load
                self._make = math.inf
