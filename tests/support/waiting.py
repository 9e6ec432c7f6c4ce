"""Wait for what another thread, process or page does."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from typing import Any

from graspfx.screen.claim_server import LOOK as LOOK_AT_CLIENTS
from graspfx.screen.claim_server import ClaimServer
from tests.support.hardware import VirtualClock

LOOK = 0.002  # between two looks [s]
BUSY = 10.0  # times as long as on a machine of one's own a wait may take


def comes(condition: Callable[[], Any], seconds: float = 10.0) -> Any:
    """Wait until a condition is true, and give its value; the last one where it stays false.

    Nobody asks again after a look that was true: a condition may be an act, as a question to a device is. Looks are
    counted, and not seconds: where others use the processors each takes longer, and so does what is waited for.
    """
    looks, end = round(seconds / LOOK), time.monotonic() + BUSY * seconds
    while not (value := condition()) and looks > 0 and time.monotonic() < end:
        looks -= 1
        time.sleep(LOOK)
    return value


def wait_until(condition: Callable[[], Any], patience: float = 60.0) -> Any:
    """Wait until a condition is true, and give its value.

    Raises:
        AssertionError: it stays false for so long.
    """
    value = comes(condition, patience)
    assert value, f"not within {patience:g} s"
    return value


def finish(process: subprocess.Popen[str], patience: float = 60.0) -> tuple[str, str]:
    """Wait for the end of a process that writes little; give what it wrote.

    Raises:
        AssertionError: it does not end for so long, and was killed.
    """
    ended = comes(lambda: process.poll() is not None, patience)
    if not ended:
        process.kill()
    texts = process.communicate(timeout=patience)  # another process may hold its pipes
    assert ended, (f"no end within {patience:g} s", *texts)
    return texts


def let_pass(server: ClaimServer, seconds: float) -> None:
    """Let time pass for a server of claims on the virtual clock: one look at its clients after another."""
    for _ in range(round(seconds / LOOK_AT_CLIENTS)):
        before = [each.silence for each in list(server._clients.values())]
        VirtualClock.time += LOOK_AT_CLIENTS
        wait_until(lambda before=before: before != [each.silence for each in list(server._clients.values())])  # type: ignore[misc]
