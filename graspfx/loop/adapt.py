"""Adapter that lets a real-time loop in machine code call the C functions of a vendor's library."""

from __future__ import annotations

import ctypes
import hashlib
from typing import Any

import numpy as np

from graspfx import log
from graspfx.compile import cache as disk
from graspfx.compile.c_calls.c_signature import FLOATS, CCall, read_calls, read_comparisons
from graspfx.compile.c_calls.trampoline import (
    MISSED,
    STATE,
    Estimation,
    Role,
    Trampolines,
    width,
    words_of,
)
from graspfx.compile.emission import address, emitted, loaded, platform, require_llvm
from graspfx.errors import InputError
from graspfx.loop.device import Calls
from graspfx.loop.velocity import VelocityEstimator

KINDS = "ptr", "i64", "double", "i64"  # types of the arguments of `estimate_after`


class Adapter:
    """Machine code that calls the C functions of a device, and the memory that the machine code uses.

    Attributes:
        context: Memory whose address is passed to the machine code.
    """

    def __init__(self, parts: Trampolines, context: np.ndarray[Any, Any], *owners: object) -> None:
        self._faults, self._values, self._buffers = parts.faults, parts.plan.values, parts.plan.buffers
        self.context, self._owners = context, owners

    def value(self, code: int) -> float:
        """Return the number that caused a fault: the return value of a function, or an entry of a buffer.

        Args:
            code: Fault code, which is negative.
        """
        return float(self.context.view(np.float64)[self._values[-code - 1]])

    def fault_text(self, code: int) -> str:
        """Return the message for a fault code, which is negative."""
        function, says = self._faults[-code - 1]
        value = self.value(code)
        number = f"{value:g}" if abs(value) < 0x100 or value != int(value) else f"0x{int(value):X}"
        return f"{function} {says}{number}"

    def buffer(self, name: str) -> np.ndarray[Any, Any]:
        """Return the current contents of a buffer."""
        type_, word = self._buffers[name]
        kind = np.dtype(
            type_.replace("float", "f4").replace("double", "f8")
            if type_ in FLOATS
            else f"{type_[0]}{width(type_) // 8}"
        )
        return self.context[word:].view(kind)


def adapt(
    library: object,
    *,
    read: str,
    write: str,
    stop: str,
    ask: str = "",
    fault: str = "< 0",
    held: str = "== 1",
    errors: str = "",
    shape: tuple[int, int] = (1, 3),
    velocity: VelocityEstimator | None = None,
    **settings: float,
) -> Calls:
    """Adapt C functions of a vendor's library so that a real-time loop in machine code can call them.

        calls = adapt(
            library,
            read="int dhdGetPosition(out 0, out 1, out 2, i8 id)",
            write="int dhdSetForce(in 0, in 1, in 2, i8 id)",
            stop="int dhdSetForce(double 0, double 0, double 0, i8 id)",
            velocity=estimator,
            id=0,
        )

    Each of `read`, `write`, `stop` and `ask` is one call in the syntax of a C declaration, or several calls separated
    by `;`. A call reads or fills a block of numbers: for `ask` and `read`, positions followed by velocities; for
    `write` and `stop`, forces. An argument of a call is

    - `in 0`, the value of entry 0 of the block, or `in 0:3`, the address of entries 0, 1 and 2;
    - `out 0` or `out 0:3`, the address of entries that the function fills;
    - a type and a number, such as `double 0` or `u32 0x2050`, or a type and the name of a setting, such as `i8 id`;
    - a type with a size, and a name, such as `i32[17] status`: a buffer.

    A factor after an `in` or `out` argument, such as `* 0.001`, multiplies `in` entries before the call and `out`
    entries after the call. Types are void, char, short, int, long, uint, ulong, i8 to i64, u8 to u64, float and double.
    `u32[3]` before the name of a function declares that the function returns a struct of three numbers, of which only
    the first is tested.

    The return value of each call is tested. After a fault, the remaining calls in the same text are not made, so that
    they cannot hide the fault; only the calls in `stop` are all made.

    Args:
        library: `ctypes.CDLL`, or another object whose attributes are ctypes functions.
        read, write, stop, ask: Calls that read the device, write forces, stop the device, and request a reading. If
            `ask` is empty, no request is sent before a reading.
        fault: Condition for a fault: comparisons of the return value or of an entry of a buffer, joined by `or`, such
            as "< 0 or status[5] == 0".
        held: Condition under which `read` has returned no new sample, in the same syntax as `fault`.
        errors: Call that removes the newest error from the error stack of the library, and returns 0 if the stack is
            empty. It is made after each other call, repeatedly until the stack is empty. Any error is a fault.
        shape: Shape (k, d) of the device.
        velocity: Estimator of velocities if `read` fills only positions; None if `read` also fills velocities.
        settings: Value of each setting that is named in the calls.

    Raises:
        MissingPackageError: If LLVM is not installed.
        InputError: If a text does not follow this syntax, an entry is out of range, the library does not have a
            function, or the names of the settings differ from the names in the calls.
    """
    k, d = shape
    texts = {"ask": ask, "read": read, "write": write, "stop": stop}
    sizes = {"ask": 2 * k * d, "read": 2 * k * d, "write": k * d, "stop": k * d}
    calls = {name: read_calls(name, text, sizes[name]) if text or name != "ask" else () for name, text in texts.items()}
    popping: CCall | None = read_calls("errors", errors, 0)[0] if errors else None
    judges = [read_comparisons(name, text) for name, text in (("fault", fault), ("held", held))]
    require_llvm()
    estimation = None if velocity is None else _estimation(velocity, k * d)
    roles = [Role(name, each, estimation if name == "read" else None) for name, each in calls.items() if each]
    faults, repeats = judges
    parts = Trampolines(roles, faults, repeats, popping)
    buffers = parts.plan.buffers
    for each in (*judges[0], *judges[1]):
        if each.buffer and not (each.buffer in buffers and each.entry < _entries(calls, each.buffer)):
            raise InputError("fault", fault, f"entries of buffers in the calls, not {each.subject}")
    context = np.zeros(parts.plan.size, dtype=np.int64)
    words = context.view(np.uint64)
    _fill_settings(parts, words, settings)
    for name, word in parts.plan.functions.items():
        words[word] = _symbol(library, name)
    if velocity is not None:
        state, _, missed = velocity.memory
        words[MISSED], words[STATE] = missed.ctypes.data, state.ctypes.data
    engine = c_engine(parts.text)
    addresses = {role.name: address(engine, f"graspfx_{role.name}") for role in roles}
    return Calls(
        addresses.get("ask", 0), addresses["read"], addresses["write"], addresses["stop"], context.ctypes.data,
        Adapter(parts, context, engine, library, velocity),
    )  # fmt: skip


def _estimation(velocity: VelocityEstimator, count: int) -> Estimation:
    """Load the kernel that estimates the velocities of `count` components."""
    from graspfx.compile.symbol import symbol_of
    from graspfx.loop.velocity import estimate_after

    state, stride, _ = velocity.memory
    if len(state) != count * stride:
        raise InputError("velocity", len(state) // stride, f"an estimator of {count} components, k d of `shape`")
    return Estimation(symbol_of(estimate_after, KINDS), count, stride)


def _entries(calls: dict[str, tuple[CCall, ...]], buffer: str) -> int:
    """Return the number of entries of a buffer."""
    arguments = [each for role in calls.values() for call in role for each in call.arguments]
    return next(each.count for each in arguments if each.kind == "buffer" and each.name == buffer)


def _fill_settings(parts: Trampolines, words: np.ndarray[Any, Any], settings: dict[str, float]) -> None:
    room = parts.plan.settings
    if set(room) != set(settings):
        raise InputError("settings", sorted(settings), f"the settings named in the calls: {sorted(room)}")
    for name, (type_, word) in room.items():
        value = settings[name]
        if type_ not in FLOATS:
            low = -(1 << (width(type_) - 1)) if type_.startswith("i") else 0
            if value != int(value) or not low <= value < low + (1 << width(type_)):
                raise InputError(name, value, f"a whole number in the range of {type_}")
        words[word] = words_of(type_, value)


def _symbol(library: object, name: str) -> int:
    """Return the address of a function in a library."""
    try:
        function = getattr(library, name)
        place = ctypes.cast(function, ctypes.c_void_p).value
    except (AttributeError, ctypes.ArgumentError, TypeError) as error:
        raise InputError(
            "library", library, f"a library with the C function {name}", "check the name and version of the library"
        ) from error
    if not place:
        raise InputError("library", library, f"a library with the C function {name}", "the function's address is zero")
    return place


def c_engine(text: str) -> Any:
    """Load the machine code of LLVM IR, and compile the IR first if its machine code is not cached."""
    key = hashlib.sha256("\0".join([*platform(), "calls", text]).encode()).hexdigest()
    machine = disk.load(key)
    if machine is None:
        machine = emitted(text)
        note = disk.store(key, machine)
        log.info("C calls %s: %d kB of machine code%s", key[:12], len(machine) // 1000, f"; {note}" if note else "")
    return loaded([machine], ())
