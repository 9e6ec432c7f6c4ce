"""All that an observer does in a sample, as one function of the object's block and its own."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.coupling.grasp_state import GraspState
from graspfx.loop.energy.books import LedgerState
from graspfx.loop.energy.brake import control
from graspfx.loop.energy.ledger import hold, observe, report


@kernel
def watch(grasp: GraspState, ledger: LedgerState, T: float) -> int:
    """Book the sample that has ended, brake if asked to, store what the next one holds, and report; give 0.

    What obstacles did to the body in that sample has to stand in the ledger before (`Observer.met`).
    """
    observe(grasp, ledger, T)
    if ledger.control:
        control(grasp, ledger, T)
    hold(grasp, ledger)
    report(grasp, ledger)
    return 0
