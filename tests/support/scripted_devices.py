"""Devices that follow a script, by Python's methods or by C functions: both read the same numbers and note the same."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.emission import address, emitted, loaded
from graspfx.errors import DeviceError
from graspfx.loop.device import Calls, Features

FloatArray = NDArray[np.float64]

PEAK = 3.0  # of a finger [N]
SETTLING = 1000  # readings of a device at rest before its script begins, at most
DRIVER = '''
"""Devices that follow a script, in the order in which they were connected."""
from tests.support.scripted_devices import Plain, Scripted

devices = []

def connect(native=True, **settings):
    devices.append((Scripted if native else Plain)(**settings))
    return devices[-1]
'''
# A context: reading, writes, stops, last reading, width, codes of read, numbers of read, codes of write, noted forces.
TEXT = """
define i64 @read(ptr %c, ptr %block) {
start:
  %at = load i64, ptr %c
  %last.p = getelementptr i64, ptr %c, i64 3
  %last = load i64, ptr %last.p
  %more = icmp slt i64 %at, %last
  %next = add i64 %at, 1
  %new = select i1 %more, i64 %next, i64 %last
  store i64 %new, ptr %c
  %width.p = getelementptr i64, ptr %c, i64 4
  %width = load i64, ptr %width.p
  %codes.p = getelementptr i64, ptr %c, i64 5
  %codes = load ptr, ptr %codes.p
  %numbers.p = getelementptr i64, ptr %c, i64 6
  %numbers = load ptr, ptr %numbers.p
  %code.p = getelementptr i64, ptr %codes, i64 %new
  %code = load i64, ptr %code.p
  %fresh = icmp eq i64 %code, 0
  br i1 %fresh, label %go, label %end
go:
  %first = mul i64 %new, %width
  br label %turn
turn:
  %i = phi i64 [ 0, %go ], [ %i.next, %turn ]
  %from = add i64 %first, %i
  %from.p = getelementptr double, ptr %numbers, i64 %from
  %x = load double, ptr %from.p
  %to.p = getelementptr double, ptr %block, i64 %i
  store double %x, ptr %to.p
  %i.next = add i64 %i, 1
  %on = icmp slt i64 %i.next, %width
  br i1 %on, label %turn, label %end
end:
  ret i64 %code
}
define i64 @write(ptr %c, ptr %block) {
start:
  %count.p = getelementptr i64, ptr %c, i64 1
  %count = load i64, ptr %count.p
  %count.next = add i64 %count, 1
  store i64 %count.next, ptr %count.p
  %at = load i64, ptr %c
  %width.p = getelementptr i64, ptr %c, i64 4
  %whole = load i64, ptr %width.p
  %width = sdiv i64 %whole, 2
  %noted.p = getelementptr i64, ptr %c, i64 8
  %noted = load ptr, ptr %noted.p
  %first = mul i64 %at, %width
  br label %turn
turn:
  %i = phi i64 [ 0, %start ], [ %i.next, %turn ]
  %from.p = getelementptr double, ptr %block, i64 %i
  %x = load double, ptr %from.p
  %to = add i64 %first, %i
  %to.p = getelementptr double, ptr %noted, i64 %to
  store double %x, ptr %to.p
  %i.next = add i64 %i, 1
  %on = icmp slt i64 %i.next, %width
  br i1 %on, label %turn, label %end
end:
  %codes.p = getelementptr i64, ptr %c, i64 7
  %codes = load ptr, ptr %codes.p
  %code.p = getelementptr i64, ptr %codes, i64 %at
  %code = load i64, ptr %code.p
  ret i64 %code
}
define i64 @stop(ptr %c, ptr %block) {
  %stops.p = getelementptr i64, ptr %c, i64 2
  %stops = load i64, ptr %stops.p
  %more = add i64 %stops, 1
  store i64 %more, ptr %stops.p
  ret i64 0
}
"""


@cache
def machine() -> Any:
    return loaded([emitted(TEXT)], ())


class Plain:
    """A device that follows a script in Python: at rest first, then a row for each reading; the last one stays.

    Args:
        readings: (N, 2, k, d) positions [m] and velocities [m/s].
        codes: of each reading: 0 fresh, 1 held, below zero a fault.
        refusals: likewise of the writing that follows it.
        rest: readings at the first row before the script goes on.
        peak: largest force [N].

    Attributes:
        written: the force that followed each reading of the script, NaN for none.
        reads, python_writes: calls of these methods.
    """

    def __init__(
        self, readings: Any, codes: Any = (), refusals: Any = (), rest: int = 0, peak: float = PEAK
    ) -> None:  # fmt: skip
        script = np.array(readings, dtype=float)
        self.numbers: FloatArray = np.concatenate([np.repeat(script[:1], rest, axis=0), script]) if rest else script
        n, _, k, d = self.numbers.shape
        self.features = Features(fingers=k, dimensions=d, peak_force=peak, watchdog=0.02)
        self.codes, self.refusals = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        for to, source in ((self.codes, codes), (self.refusals, refusals)):
            to[rest : rest + len(source)] = source
        self.noted: FloatArray = np.full((n, k, d), np.nan)
        self.context = np.zeros(9, dtype=np.int64)
        self.context[0], self.context[3], self.context[4] = -1, n - 1, 2 * k * d
        self.context[5:] = [each.ctypes.data for each in (self.codes, self.numbers, self.refusals, self.noted)]
        self.rest, self.reads, self.python_writes, self.time = rest, 0, 0, 0.0
        self._block: FloatArray = np.zeros((2, k, d))

    @property
    def written(self) -> FloatArray:
        return self.noted[self.rest :]

    @property
    def stops(self) -> int:
        return int(self.context[2])

    def fault_text(self, code: int) -> str:
        return f"code {code}"

    def open(self, period: float) -> None:
        self.period = period

    def read(self) -> Any:
        self.reads += 1
        self.context[0] = at = min(int(self.context[0]) + 1, int(self.context[3]))
        code = int(self.codes[at])
        if code < 0:
            raise DeviceError(self.fault_text(code))
        if code == 0:
            self._block[...] = self.numbers[at]
            self.time += self.period
        return self._block[0], self._block[1], self.time

    def write(self, forces: FloatArray) -> None:
        self.python_writes += 1
        self.context[1] += 1
        at = int(self.context[0])
        self.noted[at] = forces
        if self.refusals[at]:
            raise DeviceError(self.fault_text(int(self.refusals[at])))

    def stop(self) -> None:
        self.context[2] += 1

    def close(self) -> None: ...

    def __enter__(self) -> Plain:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class Scripted(Plain):
    """A device that follows a script by C functions."""

    @property
    def calls(self) -> Calls:
        read, write, stop = (address(machine(), name) for name in ("read", "write", "stop"))
        return Calls(0, read, write, stop, self.context.ctypes.data, ctypes.c_int64.from_buffer(self.context.data))
