"""LLVM text of a device's functions `i64 f(ptr context, ptr block)`, which call C functions and test the results."""

from __future__ import annotations

import platform
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

from graspfx.compile.c_calls.c_signature import FLOATS, Argument, CCall, Comparison

ORDERS = {"<": "lt", "<=": "le", ">": "gt", ">=": "ge", "==": "eq", "!=": "ne"}
BITS = {"double": 64, "float": 32}
DRAIN = 64  # largest number of errors popped from a library's stack
REPEAT = 1  # return value without a new sample; 0 with one, a negative value for a fault


@dataclass(frozen=True)
class Estimation:
    """Estimation of velocities from positions, by a kernel `double (ptr state, i64 offset, double x, i64 missed)`.

    Args:
        symbol: Name of the kernel in machine code.
        count: Number of components. The first `count` entries of the block are positions, the next are velocities.
        stride: Number of entries of the state of each component.
    """

    symbol: str
    count: int
    stride: int


@dataclass(frozen=True)
class Role:
    """One function of a device.

    Args:
        name: Name of the function: "ask", "read", "write" or "stop".
        calls: C calls of the function, in order.
        estimation: Velocity estimation after the calls; None if there is none.
    """

    name: str
    calls: tuple[CCall, ...]
    estimation: Estimation | None = None


@dataclass
class ContextPlan:
    """Layout of a context, the memory that contains the data of a device's functions, in words of 64 bits.

    The first word is the address of the number of missed samples, and the second that of the estimator's state.

    Attributes:
        functions: Word with the address of each C function.
        settings: Type of each setting, and word with its value.
        buffers: Type and first word of each buffer.
        values: Word for each fault condition, in which the value that caused a fault is stored.
        size: Number of words.
    """

    functions: dict[str, int] = field(default_factory=dict)
    settings: dict[str, tuple[str, int]] = field(default_factory=dict)
    buffers: dict[str, tuple[str, int]] = field(default_factory=dict)
    values: list[int] = field(default_factory=list)
    size: int = 2

    def function(self, name: str) -> int:
        if name not in self.functions:
            self.functions[name] = self._room(1)
        return self.functions[name]

    def setting(self, argument: Argument) -> int:
        if argument.name not in self.settings:
            self.settings[argument.name] = argument.type, self._room(1)
        return self.settings[argument.name][1]

    def buffer(self, name: str, type_: str = "", count: int = 0) -> tuple[str, int]:
        if name not in self.buffers:
            self.buffers[name] = type_, self._room((count * width(type_) + 63) // 64)
        return self.buffers[name]

    def value(self) -> int:
        """Allocate and return the word of a further fault condition."""
        self.values.append(self._room(1))
        return self.values[-1]

    def _room(self, words: int) -> int:
        self.size += words
        return self.size - words


MISSED, STATE = range(2)  # words of every context


class Trampolines:
    """LLVM text of a device's functions, and the meaning of their negative return values.

    Args:
        roles: Functions of the device.
        fault: Comparisons that are true after a call that failed.
        repeat: Comparisons that are true after a call of "read" that returned the previous sample again.
        errors: Call that removes the newest error from the error stack of a library and returns it, or returns zero if
            the stack is empty; None if the library has no such stack.

    Attributes:
        text: LLVM text of the functions.
        plan: Layout of the context.
        faults: Meaning of the return value -(1 + k), in item k: name of the C function, and text that precedes the
            compared value in a message.
    """

    def __init__(
        self, roles: Sequence[Role], fault: Sequence[Comparison], repeat: Sequence[Comparison], errors: CCall | None
    ) -> None:  # fmt: skip
        self.plan = ContextPlan()
        self.faults: list[tuple[str, str]] = []
        self._fault, self._repeat, self._errors = fault, repeat, errors
        self._lines: list[str] = []
        self._count = 0
        symbols = {role.estimation.symbol for role in roles if role.estimation}
        head = [f'declare double @"{symbol}"(ptr, i64, double, i64) nounwind' for symbol in sorted(symbols)]
        for role in roles:
            for call in role.calls:  # buffers are allocated before a comparison refers to them
                for each in call.arguments:
                    if each.kind == "buffer":
                        self.plan.buffer(each.name, each.type, each.count)
        for role in roles:
            self._role(role)
        self.text = "\n".join([*head, *self._lines, ""])

    def _name(self, kind: str = "v") -> str:
        self._count += 1
        return f"%{kind}{self._count}"

    def _put(self, text: str) -> None:
        self._lines.append(f"  {text}")

    def _op(self, text: str) -> str:
        name = self._name()
        self._put(f"{name} = {text}")
        return name

    def _at(self, word: int) -> str:
        return self._op(f"getelementptr i64, ptr %context, i64 {word}")

    def _role(self, role: Role) -> None:
        """Write the text of one function. After a failed call, "stop" continues; other functions return."""
        self._lines.append(f"define i64 @graspfx_{role.name}(ptr %context, ptr %block) nounwind {{")
        self._lines.append("start:")
        verdict = "0"
        for call in role.calls:
            result = self._call(call)
            verdict = self._judged(role, call, result, verdict)
        if role.estimation is not None:
            self._estimate(role.estimation, verdict)
        self._put(f"ret i64 {verdict}")
        self._lines.append("}")

    # A call -------------------------------------------------------------------------------------------------------

    def _call(self, call: CCall) -> str:
        operands = [self._operand(each) for each in call.arguments]
        function = self._op(f"load ptr, ptr {self._at(self.plan.function(call.name))}")
        text = f"call {_result(call)} {function}({', '.join(operands)})"
        result = ""
        if call.result == "void":
            self._put(text)
        else:
            result = self._op(text)
        for each in call.arguments:
            if each.kind == "out" and each.factor != 1.0:
                for k in range(each.count):
                    place = self._op(f"getelementptr double, ptr %block, i64 {each.first + k}")
                    value = self._op(f"load double, ptr {place}")
                    self._put(f"store double {self._op(f'fmul double {value}, {_double(each.factor)}')}, ptr {place}")
        if call.parts > 1:  # only its first number is tested
            if call.parts > 2:
                result = self._op(f"extractvalue {_struct(call)} {result}, 0")
            result = self._op(f"trunc i64 {result} to i32")
        return result

    def _operand(self, argument: Argument) -> str:
        if argument.kind == "buffer":
            return f"ptr {self._at(self.plan.buffer(argument.name)[1])}"
        if argument.kind == "number":
            return f"{passed(argument.type)} {_constant(argument.type, argument.value)}"
        if argument.kind == "setting":
            place = self._at(self.plan.setting(argument))
            return f"{passed(argument.type)} {self._op(f'load {plain(argument.type)}, ptr {place}')}"
        place = self._op(f"getelementptr double, ptr %block, i64 {argument.first}")
        if argument.kind == "out" or (argument.count and argument.factor == 1.0):
            return f"ptr {place}"
        if argument.count:
            return f"ptr {self._scaled(argument)}"
        value = self._op(f"load double, ptr {place}")
        if argument.factor != 1.0:
            value = self._op(f"fmul double {value}, {_double(argument.factor)}")
        return f"double {value}"

    def _scaled(self, argument: Argument) -> str:
        """Write the multiplication of entries by their factor; return the address of the products."""
        room = self._op(f"alloca [{argument.count} x double]")
        for k in range(argument.count):
            place = self._op(f"getelementptr double, ptr %block, i64 {argument.first + k}")
            value = self._op(f"load double, ptr {place}")
            value = self._op(f"fmul double {value}, {_double(argument.factor)}")
            self._put(f"store double {value}, ptr {self._op(f'getelementptr double, ptr {room}, i64 {k}')}")
        return room

    # Fault conditions ----------------------------------------------------------------------------------------------

    def _judged(self, role: Role, call: CCall, result: str, verdict: str) -> str:
        """Write the tests of a call's result, which is in the operand `result` (empty for none).

        The operands `verdict` and the returned one contain the return value of the function before and after the tests.
        """
        names = {each.name for each in call.arguments if each.kind == "buffer"}
        faults = [each for each in self._fault if (each.buffer in names if each.buffer else result)]
        for each in faults:
            value, bad = self._compared(each, call, result)
            says = f"gives {each.subject} = " if each.buffer else "returns "
            verdict = self._failed(role, call, says, value, bad, verdict)
        if self._errors is not None:
            verdict = self._emptied(role, call, self._errors, verdict)
        if role.name == "read" and result:
            for each in self._repeat:
                if not each.buffer:
                    _, old = self._compared(each, call, result)
                    fine = self._op(f"icmp sge i64 {verdict}, 0")
                    both = self._op(f"and i1 {old}, {fine}")
                    verdict = self._op(f"select i1 {both}, i64 {REPEAT}, i64 {verdict}")
        return verdict

    def _compared(self, each: Comparison, call: CCall, result: str) -> tuple[str, str]:
        """Write a comparison; return the operands of the compared value, as a double, and of the result."""
        type_ = call.result
        if each.buffer:
            type_, word = self.plan.buffer(each.buffer)
            place = self._op(f"getelementptr {plain(type_)}, ptr {self._at(word)}, i64 {each.entry}")
            result = self._op(f"load {plain(type_)}, ptr {place}")
        if type_ == "float":
            result = self._op(f"fpext float {result} to double")
        elif type_ != "double":
            sign = "s" if type_.startswith("i") else "u"
            result = self._op(f"{sign}itofp {plain(type_)} {result} to double")
        order = ORDERS[each.sign]
        return result, self._op(f"fcmp {'u' if order == 'ne' else 'o'}{order} double {result}, {_double(each.number)}")

    def _failed(self, role: Role, call: CCall, says: str, value: str, bad: str, verdict: str) -> str:
        """Write the code for a failed call, and return the operand that contains the function's return value.

        The compared value is stored in the context. Then "stop" continues; other functions return the failure's code.
        """
        self.faults.append((call.name, says))
        code, here, fine, end = -len(self.faults), *(self._name(kind)[1:] for kind in ("bad", "fine", "end"))
        self._put(f"br i1 {bad}, label %{here}, label %{fine if role.name != 'stop' else end}")
        before = self._block()
        self._lines.append(f"{here}:")
        self._put(f"store double {value}, ptr {self._at(self.plan.value())}")
        if role.name != "stop":
            self._put(f"ret i64 {code}")
            self._lines.append(f"{fine}:")
            return verdict
        self._put(f"br label %{end}")
        self._lines.append(f"{end}:")
        return self._op(f"phi i64 [ {verdict}, %{before} ], [ {code}, %{here} ]")

    def _block(self) -> str:
        """Return the name of the basic block that is being written."""
        return next(line[:-1] for line in reversed(self._lines) if line.endswith(":") and not line.startswith(" "))

    def _emptied(self, role: Role, call: CCall, errors: CCall, verdict: str) -> str:
        """Write a loop that empties the error stack of a library, and the code for a failure with the oldest error."""
        before = self._block()
        loop, more, done = (self._name(kind)[1:] for kind in ("pop", "more", "done"))
        self._put(f"br label %{loop}")
        self._lines.append(f"{loop}:")
        count, first, next_count, next_first = (self._name() for _ in range(4))
        self._put(f"{count} = phi i64 [ 0, %{before} ], [ {next_count}, %{more} ]")
        self._put(f"{first} = phi i64 [ 0, %{before} ], [ {next_first}, %{more} ]")
        number = self._call(errors)
        wide = number if errors.result in ("i64", "u64") else self._op(f"zext {plain(errors.result)} {number} to i64")
        some = self._op(f"icmp ne i64 {wide}, 0")
        few = self._op(f"icmp slt i64 {count}, {DRAIN}")
        on = self._op(f"and i1 {some}, {few}")
        self._put(f"br i1 {on}, label %{more}, label %{done}")
        self._lines.append(f"{more}:")
        self._put(f"{next_count} = add i64 {count}, 1")
        self._put(f"{next_first} = add i64 {wide}, 0")
        self._put(f"br label %{loop}")
        self._lines.append(f"{done}:")
        value = self._op(f"uitofp i64 {first} to double")
        bad = self._op(f"icmp ne i64 {first}, 0")
        return self._failed(role, call, "leaves error ", value, bad, verdict)

    # Velocity -----------------------------------------------------------------------------------------------------

    def _estimate(self, estimation: Estimation, verdict: str) -> None:
        """Write the estimation of velocities for a new sample. If the sample is repeated, it is counted as missed."""
        missed_at = self._op(f"load ptr, ptr {self._at(MISSED)}")
        missed = self._op(f"load i64, ptr {missed_at}")
        state = self._op(f"load ptr, ptr {self._at(STATE)}")
        old = self._op(f"icmp eq i64 {verdict}, {REPEAT}")
        count, fresh, end = (self._name(kind)[1:] for kind in ("count", "fresh", "end"))
        self._put(f"br i1 {old}, label %{count}, label %{fresh}")
        self._lines.append(f"{count}:")
        self._put(f"store i64 {self._op(f'add i64 {missed}, 1')}, ptr {missed_at}")
        self._put(f"br label %{end}")
        self._lines.append(f"{fresh}:")
        n = estimation.count
        for j in range(n):
            x = self._op(f"load double, ptr {self._op(f'getelementptr double, ptr %block, i64 {j}')}")
            v = self._op(
                f'call double @"{estimation.symbol}"(ptr {state}, i64 {j * estimation.stride}, double {x}, '
                f"i64 {missed})"
            )
            self._put(f"store double {v}, ptr {self._op(f'getelementptr double, ptr %block, i64 {n + j}')}")
        self._put(f"store i64 0, ptr {missed_at}")
        self._put(f"br label %{end}")
        self._lines.append(f"{end}:")


def width(type_: str) -> int:
    """Return the number of bits of a type."""
    return BITS.get(type_) or int(type_[1:])


def plain(type_: str) -> str:
    """Return a type of `TYPES` as a type of LLVM, which has no unsigned integers."""
    return type_ if type_ in FLOATS or type_ == "void" else f"i{width(type_)}"


def passed(type_: str) -> str:
    """Return the LLVM type of an argument; the caller must extend integers of less than 32 bits."""
    if type_ in FLOATS or width(type_) >= 32:
        return plain(type_)
    return f"{plain(type_)} {'signext' if type_.startswith('i') else 'zeroext'}"


def words_of(type_: str, value: float) -> int:
    """Return the content of a word of a context that stores a number of a type."""
    if type_ in FLOATS:
        return int.from_bytes(struct.pack("<d" if type_ == "double" else "<f", value), "little", signed=False)
    return int(value) % (1 << width(type_))


def _result(call: CCall) -> str:
    if call.parts > 1:
        return _struct(call)
    if call.result in FLOATS or call.result == "void" or width(call.result) >= 32:
        return plain(call.result)
    return f"{'signext' if call.result.startswith('i') else 'zeroext'} {plain(call.result)}"


def _struct(call: CCall) -> str:
    """Return the LLVM type of a returned struct of 32-bit integers. On Linux, 64-bit registers contain the struct."""
    if call.parts == 2:
        return "i64"
    if platform.machine().lower() in ("aarch64", "arm64"):
        return "[2 x i64]"
    return "{ i64, i32 }" if call.parts == 3 else "{ i64, i64 }"


def _constant(type_: str, value: float) -> str:
    if type_ == "float":
        [value] = struct.unpack("<f", struct.pack("<f", value))
    return _double(value) if type_ in FLOATS else str(int(value))


def _double(value: float) -> str:
    """Return the LLVM text of a double, in hexadecimal digits, which is exact."""
    return f"0x{int.from_bytes(struct.pack('>d', value), 'big'):016X}"
