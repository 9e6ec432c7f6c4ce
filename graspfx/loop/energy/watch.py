"""All that an observer does in a sample, as one function of the object's block and its own."""

from __future__ import annotations

from typing import Any

from graspfx.loop.energy import brake, ledger


def watch(S: Any, B: Any, T: float) -> int:
    """Books the sample that has ended, brakes if asked to, keeps what the next one holds, and reports; returns 0.

    What obstacles did to the body in that sample has to stand in B before (`Observer.met`).
    """
    ledger.observe(S, B, T)
    if B[ledger.CONTROL] != 0.0:
        brake.control(S, B, T)
    ledger.hold(S, B)
    ledger.report(S, B)
    return 0
