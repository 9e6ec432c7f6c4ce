"""Instructions for all lanes: what is the same in every lane stays one number, all else is a vector, a lane each."""

from __future__ import annotations

import re

from graspfx.compile.llvm.llvm_arithmetic import BINARY_LIBM, BOOL, FLOAT, INT, LIBM, Code, Number

TOKEN = re.compile(r"\b(double|i64|i32|i1)\b|(%[\w.]+)|((?<![\w.])(?:0x[0-9A-F]+|-?\d+(?:\.\d+)?|true|false)\b)")
REGISTER = re.compile(r"%[\w.]+")
CALL = re.compile(r"call double @(llvm|graspfx)[._](\w+?)(?:\.f64)?\((.*)\)$")


class LaneCode(Code):
    """The text of one function for several lanes, written by the arithmetic of one: an operation on vectors follows.

    Args:
        lanes: side by side.
    """

    def __init__(self, lanes: int) -> None:
        super().__init__()
        self.lanes = lanes
        self.varying: set[str] = set()  # registers that are vectors

    def varies(self, *numbers: Number) -> bool:
        """Tell whether one of some numbers has a value for each lane."""
        return any(number.text in self.varying for number in numbers)

    def type_text(self, type_: str, varying: bool) -> str:
        return f"<{self.lanes} x {type_}>" if varying else type_

    def typed(self, number: Number) -> str:
        """Write a number with its type."""
        return f"{self.type_text(number.type, self.varies(number))} {number.text}"

    def op(self, type_: str, text: str) -> Number:
        if self.varying.isdisjoint(REGISTER.findall(text)):
            return self.plain(type_, text)
        call = CALL.match(text)
        if call is None:
            return self.vector(type_, self._widened(text))
        family, name, operands = call.groups()
        if family == "graspfx":
            self.used.add(name)
        called = f"llvm.{name}.v{self.lanes}f64" if family == "llvm" else f"lanes_{name}"
        return self.vector(type_, f"call {self.type_text(FLOAT, True)} @{called}({self._widened(operands)})")

    def plain(self, type_: str, text: str) -> Number:
        """Write an instruction as it stands, whose result is one number."""
        return super().op(type_, text)

    def vector(self, type_: str, text: str) -> Number:
        """Write an instruction whose result is a vector."""
        number = self.plain(type_, text)
        self.varying.add(number.text)
        return number

    def wide(self, number: Number) -> Number:
        """Give a number as a vector: the same in every lane, where it is one for all."""
        if self.varies(number):
            return number
        if not number.text.startswith("%"):
            name = self.name()
            kind = self.type_text(number.type, True)
            self.lines.append(f"  {name} = freeze {kind} {self._constant(number.type, number.text)}")
            self.varying.add(name)
            return Number(number.type, name)
        kind = self.type_text(number.type, True)
        one = self.plain(number.type, f"insertelement {kind} poison, {number.type} {number.text}, i64 0")
        mask = f"<{self.lanes} x i32> zeroinitializer"
        return self.vector(number.type, f"shufflevector {kind} {one.text}, {kind} poison, {mask}")

    def _constant(self, type_: str, text: str) -> str:
        return f"<{', '.join([f'{type_} {text}'] * self.lanes)}>"

    def _widened(self, text: str) -> str:
        """Rewrite an instruction on numbers as one on vectors."""
        type_ = ""

        def replaced(match: re.Match[str]) -> str:
            nonlocal type_
            kind, register, constant = match.groups()
            if kind:
                type_ = kind
                return self.type_text(kind, True)
            if register:
                return self.wide(Number(type_, register)).text
            return self._constant(type_, constant)

        return TOKEN.sub(replaced, text)

    # Masks --------------------------------------------------------------------------------------------------------

    def both(self, mask: Number | None, test: Number) -> Number:
        """Give the lanes of a mask in which a test holds; no poison of others comes through."""
        test = self.wide(test)
        if mask is None:
            return test
        kind = self.type_text(BOOL, True)
        return self.vector(BOOL, f"select {kind} {mask.text}, {kind} {test.text}, {kind} zeroinitializer")

    def neither(self, mask: Number | None, test: Number) -> Number:
        """Give the lanes of a mask in which a test does not hold."""
        kind = self.type_text(BOOL, True)
        test = self.wide(test)
        other = self.vector(BOOL, f"xor {kind} {test.text}, {self._constant(BOOL, 'true')}")
        return self.both(mask, other)

    def some(self, mask: Number) -> Number:
        """Tell whether a mask has a lane, the same for all."""
        bits = self.plain(f"i{self.lanes}", f"bitcast {self.type_text(BOOL, True)} {mask.text} to i{self.lanes}")
        return self.plain(BOOL, f"icmp ne i{self.lanes} {bits.text}, 0")

    def blend(self, mask: Number, one: Number, other: Number) -> Number:
        """Give one number in the lanes of a mask, the other elsewhere; both of one type."""
        if one.text == other.text:
            return one
        a, b = self.wide(one), self.wide(other)
        kind = self.type_text(one.type, True)
        return self.vector(
            one.type, f"select {self.type_text(BOOL, True)} {mask.text}, {kind} {a.text}, {kind} {b.text}"
        )

    def everyone(self) -> Number:
        """Give the mask of all lanes."""
        return self.wide(Number(BOOL, "true"))

    # Memory -------------------------------------------------------------------------------------------------------

    def address(self, array: str, index: Number) -> str:
        """Compute where the lanes of an entry begin, whose index is the same for all."""
        kind = self.type_text(FLOAT, True)
        return self.plain("ptr", f"getelementptr inbounds {kind}, ptr {array}, i64 {index.text}").text

    def load_entry(self, address: str) -> Number:
        return self.vector(FLOAT, f"load {self.type_text(FLOAT, True)}, ptr {address}, align 8")

    def store_entry(self, address: str, value: Number, mask: Number | None) -> None:
        wide = self.wide(value)
        if mask is not None:
            wide = self.blend(mask, wide, self.load_entry(address))
        self.put(f"store {self.type_text(FLOAT, True)} {wide.text}, ptr {address}, align 8")

    def places(self, array: str, index: Number, mask: Number | None) -> list[str]:
        """Compute the address of each lane's own entry; those of lanes that are not in the mask are of the first."""
        if mask is not None:
            index = self.blend(mask, index, Number(INT, "0"))
        kind, out = self.type_text(INT, True), []
        for lane in range(self.lanes):
            own = self.plain(INT, f"extractelement {kind} {index.text}, i64 {lane}")
            entry = self.plain(INT, f"mul i64 {own.text}, {self.lanes}")
            place = self.plain(INT, f"add i64 {entry.text}, {lane}")
            out.append(self.plain("ptr", f"getelementptr inbounds double, ptr {array}, i64 {place.text}").text)
        return out

    def gather(self, places: list[str]) -> Number:
        """Load a number for each lane."""
        kind, whole = self.type_text(FLOAT, True), "poison"
        for lane, place in enumerate(places):
            one = self.plain(FLOAT, f"load double, ptr {place}")
            whole = self.vector(FLOAT, f"insertelement {kind} {whole}, double {one.text}, i64 {lane}").text
        return Number(FLOAT, whole)

    def scatter(self, places: list[str], value: Number, mask: Number | None) -> None:
        """Store the number of each lane of the mask; others store what is there."""
        kind, value = self.type_text(FLOAT, True), self.wide(value)
        if mask is not None:
            value = self.blend(mask, value, self.gather(places))
        for lane, place in enumerate(places):
            one = self.plain(FLOAT, f"extractelement {kind} {value.text}, i64 {lane}")
            self.put(f"store double {one.text}, ptr {place}")


def lane_declarations(lanes: int) -> str:
    """Declare the instructions on vectors that have a name."""
    kind = f"<{lanes} x double>"
    return "".join(
        f"declare {kind} @llvm.{name}.v{lanes}f64({kind}{f', {kind}' if name == 'copysign' else ''})\n"
        for name in ("fabs", "copysign", "sqrt", "floor", "ceil", "trunc")
    )


def by_lane(name: str, lanes: int) -> str:
    """Write the function that calls one of the platform's library for each lane: the same bits as for one."""
    kinds = {"ldexp": (FLOAT, "i32")}.get(name, (FLOAT,) * (2 if name in BINARY_LIBM else 1))
    assert name == "ldexp" or name in LIBM
    vector = f"<{lanes} x double>"
    parameters = ", ".join(f"<{lanes} x {kind}> %p{k}" for k, kind in enumerate(kinds))
    head = f"define internal {vector} @lanes_{name}({parameters}) noinline nounwind willreturn memory(none) {{"
    lines, whole = [head], "poison"
    for lane in range(lanes):
        for k, kind in enumerate(kinds):
            lines.append(f"  %a{lane}.{k} = extractelement <{lanes} x {kind}> %p{k}, i64 {lane}")
        operands = ", ".join(f"{kind} %a{lane}.{k}" for k, kind in enumerate(kinds))
        lines.append(f"  %r{lane} = call double @graspfx_{name}({operands})")
        lines.append(f"  %w{lane} = insertelement {vector} {whole}, double %r{lane}, i64 {lane}")
        whole = f"%w{lane}"
    return "\n".join([*lines, f"  ret {vector} {whole}", "}"])
