"""The ledger and passivity controller in the safety chain; the ledger books the displayed forces."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.coupling.grasp_state import GraspState
from graspfx.loop.energy.books import LedgerState
from graspfx.loop.energy.watch import book_sample, store_sample
from graspfx.loop.safety.safety_state import SafetyState
from graspfx.loop.safety.tank import refill


@kernel
def open_books(grasp: GraspState, ledger: LedgerState, safety: SafetyState, T: float) -> None:
    """Book the previous sample, apply the passivity controller if enabled, and fill the tank."""
    ledger.gain, ledger.elapsed = safety.gain, safety.elapsed
    book_sample(grasp, ledger, T)
    refill(safety, ledger)


@kernel
def close_books(grasp: GraspState, ledger: LedgerState, safety: SafetyState) -> None:
    """Store the displayed forces and the part withheld after the brake, and write the report."""
    for i, finger in enumerate(ledger.fingers):
        finger.withheld = safety.fingers[i].withheld
    store_sample(grasp, ledger)
