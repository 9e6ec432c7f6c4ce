"""The measure of the time from a fault to zero force: a fault is seen, and the force is taken away after it."""

from __future__ import annotations

import sys

import pytest

from graspfx.testing.wire import compiler
from tests.support.fault_latency import FAULTS, LOOPS, latency

pytestmark = [
    pytest.mark.alone,
    pytest.mark.skipif(not sys.platform.startswith("linux") or compiler() is None, reason="a loop of Linux, and cc"),
]
TOLD = {
    "not finite": "which are not finite",
    "far away": "from the last position, expected at most",
    "hangs": "has not returned for",
    "killed": "the servo's process was ended by SIGKILL",
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("loop", LOOPS)
def test_a_fault_is_seen_and_the_force_taken_away(loop: str, fault: str) -> None:
    """`latency` raises where the force stayed; the time itself is for `python -m tests.support.fault_latency`."""
    for _ in range(5):  # a machine that is busy may end a run before, by a late tick
        time, told = latency(loop, fault)
        if time == time:
            break
    words = {"python": "the cable is out", "native": "cannot be read"}[loop] if fault == "fails" else TOLD[fault]
    assert words in told
    assert time > 0.0
