"""The sample of a grasp as machine code, that of the step: the bits of the kernel that Python runs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec

import numpy as np

from graspfx.coupling.grasped import GraspedObject
from graspfx.loop.engine import program


def compiled_sample(grasped: GraspedObject) -> Callable[[], int]:
    """Give a function that computes a sample of this grasp as `GraspedObject.sample` does, some hundred times as fast.

    Where there is no LLVM it is that method itself.
    """
    if find_spec("llvmlite") is None:
        return grasped.sample
    return partial(program().bind(grasped.block, np.empty(1)).brief, 0, 0, -1, 0)
