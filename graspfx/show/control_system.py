"""A linearisation as a system of python-control: closed, or opened where the coupling's forces act."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.loop import open_loop
from graspfx.errors import MissingPackageError, UnknownNameError

LOOPS = ("closed", "open")


def to_control(linear: Linearisation, loop: str = "closed") -> Any:
    """Convert a linearisation; its docstring is that of `Linearisation.to_control`."""
    try:
        import control
    except ImportError as error:
        raise MissingPackageError.of_extra("control", "Linearisation.to_control", "control") from error
    if loop not in LOOPS:
        raise UnknownNameError("loop", str(loop), LOOPS)
    m, r = linear.coordinates
    opened = open_loop(linear)
    forces = [f"f[{i}]" for i in range(m)]
    if loop == "open":
        return control.StateSpace(
            opened.A, opened.B, -opened.C, np.zeros((m, m)), linear.period, remove_useless_states=False,
            inputs=[f"u[{i}]" for i in range(m)], outputs=[f"minus {name}" for name in forces], name="opened loop",
        )  # fmt: skip
    motion = np.zeros((m + r, len(opened.A)))
    motion[:m, :m], motion[m:, 2 * m : 2 * m + r] = np.eye(m), np.eye(r)
    C = np.vstack([motion, opened.C])
    names = [*(f"x[{i}]" for i in range(m)), *(f"q[{j}]" for j in range(r)), *forces]
    return control.StateSpace(
        opened.A + opened.B @ opened.C, opened.hand, C, np.zeros((len(C), m)), linear.period,
        remove_useless_states=False, inputs=[f"hand[{i}]" for i in range(m)], outputs=names, name="grasp",
    )  # fmt: skip
