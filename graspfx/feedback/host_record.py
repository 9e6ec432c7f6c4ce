"""Record in shared memory between a host program and the loop: layout, creation, and search by name.

All words are float64 in the machine's byte order. With n fingers of d coordinates, a header of 64 words is followed by
8 slots of the host and 8 slots of the loop:

    header  0 magic 71301955, 1 version 1, 2 n, 3 d, 4 period [s], 5 slots (8), 6 first word of the host's slots, 7
            words of each, 8 and 9 the same for the loop's slots, 10 state (1 running, 2 ended, 3 a fault), 11 code of
            the fault, 12 number of the host's last sample, 13 number of the loop's last sample
    host    0 number k = 1, 2, ..., 1 time of the host [s], 2 zero, or a code that ends the run (1: the host has ended,
            2: not finite, 3: too large), then n d external and n d internal forces on the operator [N], n d positions
            of the operator from which the sample was computed [m], and the sum of all previous words of the slot
    loop    0 number, 1 time [s], 2 age of the host's last sample [s], 3 and 4 energies of the tanks of push and squeeze
            [J], 5 samples lost, 6 samples that came late, then n d positions [m], n d velocities [m/s], n d forces on
            the operator [N], and the sum

Sample k is in slot k mod 8. A writer writes the slot first, and then the slot's number into the header. A reader uses a
slot if its first word is the number in the header and its last word is the sum of the other words, added in order.
Otherwise the reader reads again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import DeviceError
from graspfx.system import shared_memory

FloatArray = NDArray[np.float64]

MAGIC, VERSION, HEAD, SLOTS = 71301955.0, 1.0, 64, 8
FINGERS, DIMENSIONS, PERIOD = 2, 3, 4
HOST_FIRST, HOST_SIZE, LOOP_FIRST, LOOP_SIZE = 6, 7, 8, 9
STATE, CODE, HOST_NUMBER, LOOP_NUMBER = 10, 11, 12, 13
RUNNING, ENDED, FAULT = 1.0, 2.0, 3.0
SAMPLE, LOOP_SAMPLE = 3, 7  # words of a slot before its arrays
SILENT, HOST_ENDED, NOT_FINITE, TOO_LARGE = 0, 1, 2, 3  # reasons why the host's forces are zero


@dataclass(frozen=True)
class HostRecord:
    """Record of a loop, invisible to hosts until it is published.

    Attributes:
        name: Name under which hosts find the record.
        words: Content of the record, as float64 words.
        shared: Shared memory of the record.
    """

    name: str
    words: FloatArray
    shared: shared_memory.Named

    def publish(self) -> None:
        """Make the record visible to hosts.

        Raises:
            DeviceError: If another loop runs under this name.
        """
        self.words[STATE] = RUNNING
        if not self.shared.publish():
            raise DeviceError(
                f"host.name {self.name!r}: another run has this name; end it, or give this scene another host.name"
            )

    def close(self) -> None:
        """Report to the host that the loop has ended, and remove the name."""
        if self.words[STATE] == RUNNING:
            self.words[STATE] = ENDED
        self.shared.close()


def make_record(name: str, fingers: int, dimensions: int, period: float) -> HostRecord:
    """Create the record of a loop."""
    size = fingers * dimensions
    host, loop = SAMPLE + 3 * size + 1, LOOP_SAMPLE + 3 * size + 1
    shared = shared_memory.Named(name, 8 * (HEAD + SLOTS * (host + loop)))
    words = np.frombuffer(shared.memory, np.float64)
    words[2:10] = fingers, dimensions, period, SLOTS, HEAD, host, HEAD + SLOTS * host, loop
    words[0], words[1] = MAGIC, VERSION
    return HostRecord(name, words, shared)


def find_record(name: str) -> FloatArray | None:
    """Find the record of a running loop; return None if there is none.

    Raises:
        DeviceError: If the record has another version.
    """
    memory = shared_memory.find(name)
    if memory is None:
        return None
    words = np.frombuffer(memory, np.float64)
    if len(words) < HEAD or words[0] != MAGIC:
        return None
    if words[1] != VERSION:
        raise DeviceError(f"host.name {name!r}: the loop has version {words[1]:g} of the record, expected {VERSION:g}")
    return words if words[STATE] == RUNNING else None


def reason(code: int, silence: float) -> str:
    """Return the message for a code that makes the host's forces zero."""
    text = {
        SILENT: f"the host sent no new sample for more than host.silence, {silence:g} s: it has ended or is blocked",
        HOST_ENDED: "the host has ended",
        NOT_FINITE: "the host sent a force that is not finite: its simulation has diverged",
        TOO_LARGE: "the host sent a force above host.largest: check for impacts with stiff contacts and wrong units",
    }.get(code, f"the host stopped the run with code {code}")
    return f"{text}; all forces are zero"


def total(slot: FloatArray) -> float:
    """Return the sum of a slot's words except the last, added in order."""
    return float(sum(slot[:-1].tolist()))
