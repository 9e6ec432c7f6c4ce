"""LLVM text of conversions and operators of numbers, with the same results as in CPython."""

from __future__ import annotations

import ast
import struct
from collections.abc import Sequence
from typing import NamedTuple

BOOL, INT, FLOAT = "i1", "i64", "double"
WIDTH = {BOOL: 0, INT: 1, FLOAT: 2}  # two numbers are converted to the wider type
Type = str | tuple[str, ...] | None  # type of a number, a tuple, or a function that returns nothing
LIBM = (
    "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cos", "cosh", "exp", "expm1", "fmod", "log", "log10",
    "log1p", "log2", "pow", "sin", "sinh", "tan", "tanh",
)  # fmt: skip
BINARY_LIBM = ("atan2", "fmod", "pow")
EXACT = {"sqrt": "sqrt", "fabs": "fabs", "copysign": "copysign"}  # correctly rounded functions with instructions
ROUNDED = {"floor": "floor", "ceil": "ceil", "trunc": "trunc"}
FLOATS = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul"}
INTS = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
ORDERS = {ast.Eq: "eq", ast.NotEq: "ne", ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge"}


class Number(NamedTuple):
    """Number in LLVM text: its type, and the constant or register that contains it."""

    type: str
    text: str


class LlvmFunction(NamedTuple):
    """Function in LLVM text, for one combination of argument types: its name and the type of its result."""

    name: str
    result: Type


class Code:
    """LLVM text of a function while it is written."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.slots: dict[str, str] = {}
        self.used: set[str] = set()
        self.count = 0
        self.block = "start"

    def name(self, kind: str = "v") -> str:
        self.count += 1
        return f"%{kind}{self.count}"

    def put(self, text: str) -> None:
        self.lines.append(f"  {text}")

    def op(self, type_: str, text: str) -> Number:
        name = self.name()
        self.lines.append(f"  {name} = {text}")
        return Number(type_, name)

    def begin(self, label: str) -> None:
        self.block = label
        self.lines.append(f"{label[1:]}:")

    def go(self, label: str) -> None:
        self.put(f"br label {label}")

    def choose(self, test: Number, one: str, other: str) -> None:
        self.put(f"br i1 {test.text}, label {one}, label {other}")

    def intrinsic(self, name: str, *arguments: Number) -> Number:
        operands = ", ".join(f"double {a.text}" for a in arguments)
        return self.op(FLOAT, f"call double @llvm.{name}.f64({operands})")

    def libm(self, name: str, *arguments: Number) -> Number:
        """Write a call of a C function, by a name that LLVM does not know.

        LLVM would otherwise replace calls of functions that it knows, such as `pow`, by constants or other operations.
        """
        self.used.add(name)
        operands = ", ".join(f"double {a.text}" for a in arguments)
        return self.op(FLOAT, f"call double @graspfx_{name}({operands})")


def floating(value: float) -> Number:
    return Number(FLOAT, f"0x{struct.unpack('>Q', struct.pack('>d', value))[0]:016X}")


def constant(value: bool | int | float) -> Number:
    if isinstance(value, bool):
        return Number(BOOL, "true" if value else "false")
    return Number(INT, str(value)) if isinstance(value, int) else floating(value)


def widest(types: Sequence[str]) -> str:
    return max(types, key=WIDTH.__getitem__)


def convert(code: Code, number: Number, to: str) -> Number:
    """Write the conversion of a number to a type of the same or greater width."""
    if number.type == to:
        return number
    if number.type == BOOL:
        if number.text in ("true", "false"):
            one = int(number.text == "true")
            return floating(one) if to == FLOAT else Number(INT, str(one))
        return code.op(to, f"{'uitofp' if to == FLOAT else 'zext'} i1 {number.text} to {to}")
    if number.text.lstrip("-").isdigit():
        return floating(float(int(number.text)))
    return code.op(to, f"sitofp i64 {number.text} to double")


def truncated(code: Code, number: Number) -> Number:
    """Write the conversion int(x)."""
    if number.type == FLOAT:
        raw = code.op(INT, f"fptosi double {number.text} to i64")
        return code.op(INT, f"freeze i64 {raw.text}")  # out of range: an arbitrary number, not undefined behaviour
    return convert(code, number, INT)


def truth(code: Code, number: Number) -> Number:
    if number.type == BOOL:
        return number
    if number.type == INT:
        return code.op(BOOL, f"icmp ne i64 {number.text}, 0")
    return code.op(BOOL, f"fcmp une double {number.text}, 0.0")


def _alike(code: Code, left: Number, right: Number) -> tuple[Number, Number]:
    """Write conversions of two numbers to a common type, integer or float."""
    to = widest((left.type, right.type, INT))
    return convert(code, left, to), convert(code, right, to)


def compare(code: Code, op: ast.cmpop, left: Number, right: Number) -> Number:
    order = ORDERS[type(op)]
    a, b = _alike(code, left, right)
    if a.type == INT:
        sign = "" if order in ("eq", "ne") else "s"
        return code.op(BOOL, f"icmp {sign}{order} i64 {a.text}, {b.text}")
    return code.op(BOOL, f"fcmp {'u' if order == 'ne' else 'o'}{order} double {a.text}, {b.text}")


def select(code: Code, test: Number, one: Number, other: Number) -> Number:
    to = widest((one.type, other.type))
    one, other = convert(code, one, to), convert(code, other, to)
    return code.op(to, f"select i1 {test.text}, {one.type} {one.text}, {other.type} {other.text}")


def extreme(code: Code, name: str, numbers: Sequence[Number]) -> Number:
    """Write min or max. As in Python, the first of equal arguments is returned, and comparisons with NaN are false."""
    to = widest([n.type for n in numbers] + [INT])
    best, *others = (convert(code, n, to) for n in numbers)
    order = ast.Lt() if name == "min" else ast.Gt()
    for other in others:
        best = select(code, compare(code, order, other, best), other, best)
    return best


def absolute(code: Code, number: Number) -> Number:
    if number.type == FLOAT:
        return code.intrinsic("fabs", number)
    number = convert(code, number, INT)
    below = code.op(BOOL, f"icmp slt i64 {number.text}, 0")
    return select(code, below, code.op(INT, f"sub i64 0, {number.text}"), number)


def negative(code: Code, number: Number) -> Number:
    if number.type == FLOAT:
        return code.op(FLOAT, f"fneg double {number.text}")
    number = convert(code, number, INT)
    if number.text.lstrip("-").isdigit():
        return Number(INT, str(-int(number.text)))
    return code.op(INT, f"sub i64 0, {number.text}")


def binary(code: Code, op: ast.operator, left: Number, right: Number) -> Number:
    """Write a binary operation; the operator is one of + - * / // % **."""
    a, b = _alike(code, left, right)
    if isinstance(op, ast.Div):
        a, b = convert(code, a, FLOAT), convert(code, b, FLOAT)
        return code.op(FLOAT, f"fdiv double {a.text}, {b.text}")
    if isinstance(op, ast.Pow):
        return _power(code, a, b)
    if a.type == INT:
        if type(op) in INTS:
            return code.op(INT, f"{INTS[type(op)]} i64 {a.text}, {b.text}")
        return _whole_division(code, op, a, b)
    if type(op) in FLOATS:
        return code.op(FLOAT, f"{FLOATS[type(op)]} double {a.text}, {b.text}")
    return _division(code, op, a, b)


def _power(code: Code, a: Number, b: Number) -> Number:
    if a.type == INT and b.text.isdigit():  # an integer to a constant power of 0 or more stays an integer
        result = Number(INT, "1")
        for _ in range(int(b.text)):
            result = code.op(INT, f"mul i64 {result.text}, {a.text}")
        return result
    return code.libm("pow", convert(code, a, FLOAT), convert(code, b, FLOAT))


def _whole_division(code: Code, op: ast.operator, a: Number, b: Number) -> Number:
    """Write // or % of integers. If the divisor is zero, where CPython raises an exception, the result is 0."""
    divisor = b
    odd = Number(BOOL, "false")
    if not b.text.isdigit() or b.text == "0":  # the processor traps on a divisor of 0, and on -2^63 by -1
        odd = code.op(BOOL, f"icmp eq i64 {b.text}, 0")
        minus = code.op(BOOL, f"icmp eq i64 {b.text}, -1")
        unsafe = code.op(BOOL, f"or i1 {odd.text}, {minus.text}")
        divisor = select(code, unsafe, Number(INT, "1"), b)
    quotient = code.op(INT, f"sdiv i64 {a.text}, {divisor.text}")
    rest = code.op(INT, f"srem i64 {a.text}, {divisor.text}")
    mixed = code.op(INT, f"xor i64 {rest.text}, {divisor.text}")
    low = code.op(BOOL, f"icmp slt i64 {mixed.text}, 0")
    left = code.op(BOOL, f"icmp ne i64 {rest.text}, 0")
    down = code.op(BOOL, f"and i1 {low.text}, {left.text}")
    if isinstance(op, ast.Mod):
        return select(code, down, code.op(INT, f"add i64 {rest.text}, {divisor.text}"), rest)
    quotient = select(code, down, code.op(INT, f"sub i64 {quotient.text}, 1"), quotient)
    if odd.text == "false":
        return quotient
    signed = select(code, minus, code.op(INT, f"sub i64 0, {a.text}"), quotient)
    return select(code, odd, Number(INT, "0"), signed)


def _division(code: Code, op: ast.operator, a: Number, b: Number) -> Number:
    """Write // or % of floats, with the operations of CPython's function float_divmod."""
    zero = floating(0.0)
    rest = code.libm("fmod", a, b)
    some = code.op(BOOL, f"fcmp une double {rest.text}, 0.0")
    low = code.op(BOOL, f"fcmp olt double {b.text}, 0.0")
    under = code.op(BOOL, f"fcmp olt double {rest.text}, 0.0")
    differ = code.op(BOOL, f"xor i1 {low.text}, {under.text}")
    shift = code.op(BOOL, f"and i1 {some.text}, {differ.text}")
    if isinstance(op, ast.Mod):
        adjusted = select(code, shift, code.op(FLOAT, f"fadd double {rest.text}, {b.text}"), rest)
        return select(code, some, adjusted, code.intrinsic("copysign", zero, b))
    less = code.op(FLOAT, f"fsub double {a.text}, {rest.text}")
    quotient = code.op(FLOAT, f"fdiv double {less.text}, {b.text}")
    quotient = select(code, shift, code.op(FLOAT, f"fsub double {quotient.text}, 1.0"), quotient)
    whole = code.intrinsic("floor", quotient)
    error = code.op(FLOAT, f"fsub double {quotient.text}, {whole.text}")
    above = code.op(BOOL, f"fcmp ogt double {error.text}, 0.5")
    whole = select(code, above, code.op(FLOAT, f"fadd double {whole.text}, 1.0"), whole)
    ratio = code.op(FLOAT, f"fdiv double {a.text}, {b.text}")
    nothing = code.op(BOOL, f"fcmp oeq double {quotient.text}, 0.0")
    return select(code, nothing, code.intrinsic("copysign", zero, ratio), whole)


def mantissa_and_exponent(code: Code, x: Number) -> tuple[Number, Number]:
    """Write math.frexp, which returns m and e with x = m 2^e and 0.5 <= abs(m) < 1.

    If x is zero or not finite, m is x and e is 0.
    """
    size = code.intrinsic("fabs", x)
    tiny = code.op(BOOL, f"fcmp olt double {size.text}, {floating(2.0**-1022).text}")
    scaled = code.op(FLOAT, f"fmul double {x.text}, {floating(2.0**54).text}")
    bits = code.op(INT, f"bitcast double {select(code, tiny, scaled, x).text} to i64")
    shifted = code.op(INT, f"lshr i64 {bits.text}, 52")
    biased = code.op(INT, f"and i64 {shifted.text}, 2047")
    exponent = binary(code, ast.Sub(), biased, select(code, tiny, constant(1022 + 54), constant(1022)))
    low_bits = code.op(INT, f"and i64 {bits.text}, {-(2**63) | (2**52 - 1)}")
    mantissa = code.op(FLOAT, f"bitcast i64 {code.op(INT, f'or i64 {low_bits.text}, {1022 << 52}').text} to double")
    some = code.op(BOOL, f"fcmp one double {size.text}, 0.0")
    finite = code.op(BOOL, f"fcmp olt double {size.text}, 0x7FF0000000000000")
    usual = code.op(BOOL, f"and i1 {some.text}, {finite.text}")
    return select(code, usual, mantissa, x), select(code, usual, exponent, constant(0))


def _scaled(code: Code, x: Number, exponent: Number) -> Number:
    """Write math.ldexp, x 2^e. If the result overflows, where CPython raises an exception, it is infinite.

    x is multiplied by up to three powers of two, and the result is rounded only once: if a product after a factor of
    2^-969 is below 2^-1022, so that it may be rounded, the final result is zero.
    """
    left = extreme(code, "max", [constant(-2200), extreme(code, "min", [constant(2200), exponent])])
    for least, most in ((-969, 1023), (-969, 1023), (-1022, 1023)):
        high = extreme(code, "min", [constant(most), left])
        below = compare(code, ast.Lt(), left, constant(-1022))
        part = select(code, below, constant(least), high)
        biased = code.op(INT, f"add i64 {part.text}, 1023")
        power = code.op(FLOAT, f"bitcast i64 {code.op(INT, f'shl i64 {biased.text}, 52').text} to double")
        x = code.op(FLOAT, f"fmul double {x.text}, {power.text}")
        left = code.op(INT, f"sub i64 {left.text}, {part.text}")
    return x


def mathematical(code: Code, name: str, arguments: Sequence[Number]) -> Number | None:
    """Write a call of a function of the module `math`; return None if the function is not supported."""
    numbers = [convert(code, a, FLOAT) for a in arguments]
    if name in EXACT and len(numbers) == (2 if name == "copysign" else 1):
        return code.intrinsic(EXACT[name], *numbers)
    if name in LIBM and len(numbers) == (2 if name in BINARY_LIBM else 1):
        return code.libm(name, *numbers)
    if name == "ldexp" and len(numbers) == 2 and arguments[1].type != FLOAT:
        return _scaled(code, numbers[0], arguments[1])
    if len(numbers) != 1:
        return None
    [x] = numbers
    if name in ROUNDED:
        return arguments[0] if arguments[0].type == INT else truncated(code, code.intrinsic(ROUNDED[name], x))
    if name == "isnan":
        return code.op(BOOL, f"fcmp uno double {x.text}, 0.0")
    if name in ("isinf", "isfinite"):
        order = "oeq" if name == "isinf" else "olt"
        return code.op(BOOL, f"fcmp {order} double {code.intrinsic('fabs', x).text}, 0x7FF0000000000000")
    return None
