"""An observer's work in a sample, as one function of the object's block and its own."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.coupling.grasp_state import GraspState
from graspfx.loop.energy.books import LedgerState
from graspfx.loop.energy.brake import control
from graspfx.loop.energy.ledger import hold, observe, report


@kernel
def watch(grasp: GraspState, ledger: LedgerState, T: float) -> int:
    """Book the sample that has ended, brake under control, store the forces of the next one, and report; give 0.

    The obstacles' wrench on the body in that sample has to stand in the ledger before (`Observer.met`).
    """
    book_sample(grasp, ledger, T)
    store_sample(grasp, ledger)
    return 0


@kernel
def book_sample(grasp: GraspState, ledger: LedgerState, T: float) -> None:
    """Book the sample that has ended, and brake under control: the first half of `watch`."""
    observe(grasp, ledger, T)
    if ledger.control:
        control(grasp, ledger, T)


@kernel
def store_sample(grasp: GraspState, ledger: LedgerState) -> None:
    """Store the forces of the next sample, as they are displayed, and report: the second half of `watch`."""
    hold(grasp, ledger)
    report(grasp, ledger)
