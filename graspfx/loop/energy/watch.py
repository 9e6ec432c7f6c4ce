"""The observer's work in a sample, as a function of the object's block and the observer's memory."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.coupling.grasp_state import GraspState
from graspfx.loop.energy.books import LedgerState
from graspfx.loop.energy.brake import control
from graspfx.loop.energy.ledger import hold, observe, report


@kernel
def watch(grasp: GraspState, ledger: LedgerState, T: float) -> int:
    """Book the previous sample, apply the passivity controller, store the next sample's forces, and report; return 0.

    The ledger must already contain the obstacles' wrench on the body in that sample (`Observer.met`).
    """
    book_sample(grasp, ledger, T)
    store_sample(grasp, ledger)
    return 0


@kernel
def book_sample(grasp: GraspState, ledger: LedgerState, T: float) -> None:
    """Book the previous sample and apply the passivity controller if enabled: the first half of `watch`."""
    observe(grasp, ledger, T)
    if ledger.control:
        control(grasp, ledger, T)


@kernel
def store_sample(grasp: GraspState, ledger: LedgerState) -> None:
    """Store the displayed forces for the next sample and report: the second half of `watch`."""
    hold(grasp, ledger)
    report(grasp, ledger)
