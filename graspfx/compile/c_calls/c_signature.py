"""Parser of C calls that are given as text, such as `int dhdGetPosition(out 0, out 1, out 2, i8 id)`."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from graspfx.errors import InputError

LONG = f"i{8 * ctypes.sizeof(ctypes.c_long)}"
TYPES = {
    "void": "void", "double": "double", "float": "float",
    "char": "i8", "short": "i16", "int": "i32", "long": LONG,
    "uint": "u32", "ulong": LONG.replace("i", "u"),
    **{f"{sign}{bits}": f"{sign}{bits}" for sign in "iu" for bits in (8, 16, 32, 64)},
}  # fmt: skip
FLOATS = ("double", "float")
SIGNS = ("<=", ">=", "==", "!=", "<", ">")
TOKEN = re.compile(
    r"\s*(0[xX][0-9a-fA-F]+|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[A-Za-z_]\w*|<=|>=|==|!=|[-(){}\[\],;:*<>])"
)
NUMBER = re.compile(r"0[xX]|[-+]?[\d.]")
GRAMMAR = "calls such as 'int dhdGetPosition(out 0, out 1, out 2, i8 id)', separated by ';'"
MOST = 4096  # largest number of entries of a buffer


@dataclass(frozen=True)
class Argument:
    """Argument of a C function.

    Attributes:
        kind: "in" or "out" for entries of a device's block of doubles, "setting" or "buffer" for a named value or
            memory, "number" for a constant.
        type: "double" for entries of the block; otherwise one of the values of TYPES.
        first: Index of the first entry of the block, if `kind` is "in" or "out".
        count: Number of entries of the block, or of the buffer, whose address is passed; 0 if a number is passed.
        factor: Factor by which entries of the block are multiplied, before the call for "in" and after it for "out".
        name: Name of the setting or buffer.
        value: Value of the constant.
    """

    kind: str
    type: str = "double"
    first: int = 0
    count: int = 0
    factor: float = 1.0
    name: str = ""
    value: float = 0.0


@dataclass(frozen=True)
class CCall:
    """Call of a C function.

    Attributes:
        result: Type of the result, or of the members of a returned struct.
        name: Name of the function.
        arguments: Arguments.
        parts: Number of members of a returned struct; 1 if the function does not return a struct.
    """

    result: str
    name: str
    arguments: tuple[Argument, ...]
    parts: int = 1


@dataclass(frozen=True)
class Comparison:
    """Comparison of the return value of a call, or of an entry of a buffer, with a number.

    Attributes:
        sign: Operator of the comparison.
        number: Number on the right side.
        buffer: Name of the buffer; empty if the return value is compared.
        entry: Index of the entry of the buffer.
    """

    sign: str
    number: float
    buffer: str = ""
    entry: int = 0

    @property
    def subject(self) -> str:
        """Left side of the comparison as text; empty for the return value."""
        return f"{self.buffer}[{self.entry}]" if self.buffer else ""


class Reader:
    """Reads a text token by token.

    Args:
        subject: Name of the argument that contained the text, for error messages.
        text: Text of calls or comparisons.
        size: Number of entries of the block to which the text may refer.
    """

    def __init__(self, subject: str, text: object, size: int = 0) -> None:
        if not isinstance(text, str):
            raise InputError(subject, text, f"a text: {GRAMMAR}")
        self.subject, self.text, self.size = subject, text, size
        self.tokens = list(self._tokens())
        self.at = 0

    def _tokens(self) -> Iterator[str]:
        at = 0
        while self.text[at:].strip():
            match = TOKEN.match(self.text, at)
            if match is None:
                raise self.wrong(f"{self.text[at:].strip()[:12]!r} is not a valid token")
            yield match.group(1)
            at = match.end()

    def wrong(self, why: str) -> InputError:
        return InputError(self.subject, self.text, GRAMMAR, why)

    @property
    def next(self) -> str:
        """Next token; empty at the end of the text."""
        return self.tokens[self.at] if self.at < len(self.tokens) else ""

    def take(self, *expected: str) -> str:
        """Consume and return the next token. If `expected` is not empty, the token must be one of its items."""
        token = self.next
        if not token or (expected and token not in expected):
            words = " or ".join(map(repr, expected)) if expected else "more"
            raise self.wrong(f"{words} expected{f' before {token!r}' if token else ' at the end'}")
        self.at += 1
        return token

    def has(self, token: str) -> bool:
        """Consume the next token if it is equal to `token`, and return whether it was."""
        if self.next != token:
            return False
        self.at += 1
        return True

    def name(self) -> str:
        token = self.take()
        if not token.isidentifier():
            raise self.wrong(f"a name expected, not {token!r}")
        return token

    def number(self) -> float:
        token = self.take()
        if not NUMBER.match(token):
            raise self.wrong(f"a number expected, not {token!r}")
        return float(int(token, 16)) if token[:2].lower() == "0x" else float(token)

    def whole(self) -> int:
        number = self.number()
        if number != int(number) or number < 0:
            raise self.wrong(f"a non-negative integer expected, not {number:g}")
        return int(number)

    def type(self) -> str:
        token = self.name()
        if token not in TYPES:
            raise self.wrong(f"unknown type {token!r}; known types: {', '.join(TYPES)}")
        return TYPES[token]


def read_calls(subject: str, text: object, size: int) -> tuple[CCall, ...]:
    """Parse calls of C functions, separated by semicolons.

    Args:
        subject: Name of the argument that contained the text, for error messages.
        text: Text of the calls.
        size: Number of entries of the block.

    Raises:
        InputError: If the text is invalid, a type is unknown, or an entry of the block is out of range.
    """
    reader, calls = Reader(subject, text, size), []
    while True:
        calls.append(_call(reader))
        if not reader.has(";"):
            break
        if not reader.next:
            break
    if reader.next:
        raise reader.wrong(f"';' expected before {reader.next!r}")
    _require_one_size(reader, calls)
    return tuple(calls)


def _call(reader: Reader) -> CCall:
    result, parts = reader.type(), 1
    if reader.has("["):
        parts = reader.whole()
        reader.take("]")
        if (result != "i32" and result != "u32") or parts not in (2, 3, 4):
            raise reader.wrong("a returned struct has two to four 32-bit numbers")
    name = reader.name()
    reader.take("(")
    arguments: list[Argument] = []
    while not reader.has(")"):
        if arguments:
            reader.take(",")
        arguments.append(_argument(reader))
    return CCall(result, name, tuple(arguments), parts)


def _argument(reader: Reader) -> Argument:
    if reader.next in ("in", "out"):
        return _entries(reader, reader.take())
    type_ = reader.type()
    if type_ == "void":
        raise reader.wrong("an argument cannot be void")
    if reader.has("["):
        count = reader.whole()
        reader.take("]")
        if not 1 <= count <= MOST:
            raise reader.wrong(f"a buffer has 1 to {MOST} entries")
        return Argument("buffer", type_, count=count, name=reader.name())
    if NUMBER.match(reader.next):
        number = reader.number()
        if type_ not in FLOATS and number != int(number):
            raise reader.wrong(f"{number:g} is not an integer, as {type_} requires")
        return Argument("number", type_, value=number)
    return Argument("setting", type_, name=reader.name())


def _entries(reader: Reader, kind: str) -> Argument:
    first = reader.whole()
    last, count = first + 1, 0
    if kind == "out":
        count = 1
    if reader.has(":"):
        last = reader.whole()
        count = last - first
        if count < 1:
            raise reader.wrong(f"entries {first}:{last} form an empty range")
    if last > reader.size:
        raise reader.wrong(f"entry {last - 1} is out of range: the block has {reader.size} entries, counted from 0")
    factor = reader.number() if reader.has("*") else 1.0
    return Argument(kind, first=first, count=count, factor=factor)


def _require_one_size(reader: Reader, calls: Sequence[CCall]) -> None:
    """Raise an InputError if a buffer has different types or sizes in two calls."""
    buffers: dict[str, tuple[str, int]] = {}
    for call in calls:
        for each in call.arguments:
            if each.kind == "buffer" and buffers.setdefault(each.name, (each.type, each.count)) != (
                each.type, each.count
            ):  # fmt: skip
                raise reader.wrong(f"{each.name!r} is a buffer of two types or sizes")


def read_comparisons(subject: str, text: object) -> tuple[Comparison, ...]:
    """Parse comparisons that are separated by `or`, such as `< 0 or status[5] == 0`; the text may be empty.

    Raises:
        InputError: If the text is invalid.
    """
    reader, comparisons = Reader(subject, text), list[Comparison]()
    while reader.next:
        if comparisons:
            reader.take("or")
        buffer, entry = "", 0
        if reader.next not in SIGNS:
            buffer = reader.name()
            reader.take("[")
            entry = reader.whole()
            reader.take("]")
        comparisons.append(Comparison(reader.take(*SIGNS), reader.number(), buffer, entry))
    return tuple(comparisons)
