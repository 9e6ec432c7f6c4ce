"""Random programs in the language of kernels: nested branches and loops, entries, calls, tuples, every operator.

A name has one kind: where it is a float on one way and a whole number on another, it is a float for machine code.
"""

from __future__ import annotations

import random

ENTRIES = 12  # of the buffer that a program reads and writes
FLOATS, WHOLES = ("x", "y", "z"), ("i", "j", "k")
DEEP = 3


class Writer:
    """One module of random functions f0, f1, ..., each of which may call those before it."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.lines: list[str] = ["import math", ""]
        self.count = 0
        self.loops = 0

    def function(self) -> None:
        """Write one more function; f(A, x, y, i, j) gives two numbers."""
        head = f"def f{self.count}(A, x: float, y: float, i: int, j: int):"
        self.lines += ["", "", head, "    z = 0.25", "    k = 3"]
        self.loops = 0
        for _ in range(self.rng.randint(3, 7)):
            self.statement(1, inside=False)
        self.lines.append(f"    return {self.number(2)}, {self.whole(2)}")
        self.count += 1

    def put(self, depth: int, text: str) -> None:
        self.lines.append("    " * depth + text)

    def statement(self, depth: int, *, inside: bool) -> None:
        kinds = ["float", "whole", "entry", "augment", "tuple", "call"]
        kinds += ["if", "if", "for", "while"] if depth <= DEEP else []
        kinds += ["leave"] if inside else []
        rng = self.rng
        match rng.choice(kinds):
            case "float":
                self.put(depth, f"{rng.choice(FLOATS)} = {self.number(3)}")
            case "whole":
                self.put(depth, f"{rng.choice(WHOLES)} = {self.bounded()}")
            case "entry":
                self.put(depth, f"A[{self.index()}] = {self.number(2)}")
            case "augment":
                target = rng.choice([*FLOATS, f"A[{self.index()}]"])
                self.put(depth, f"{target} {rng.choice(['+=', '-=', '*='])} {self.number(2)}")
            case "tuple":
                one, other = rng.sample(FLOATS, 2)
                self.put(depth, f"{one}, {other} = {self.number(2)}, {self.number(2)}")
            case "call" if self.count:
                callee = f"f{rng.randrange(self.count)}"
                self.put(depth, f"{rng.choice(FLOATS)}, k = {callee}(A, {self.number(1)}, y, {self.bounded()}, j)")
            case "if":
                self.put(depth, f"if {self.test(2)}:")
                self.block(depth + 1, inside=inside)
                if rng.random() < 0.6:
                    self.put(depth, "else:")
                    self.block(depth + 1, inside=inside)
            case "for":
                bounds = rng.choice([f"{rng.randint(0, 4)}", f"{self.bounded()} % 5", f"{self.bounded()} % 6, -2, -1"])
                self.put(depth, f"for {rng.choice(WHOLES)} in range({bounds}):")
                self.block(depth + 1, inside=True)
            case "while":
                name = f"turn_{self.loops}"
                self.loops += 1
                self.put(depth, f"{name} = 0")
                self.put(depth, f"while {name} < {rng.randint(1, 4)} and {self.test(1)}:")
                self.put(depth + 1, f"{name} += 1")
                self.block(depth + 1, inside=True)
            case "leave":
                self.put(depth, f"if {self.test(1)}:")
                self.put(depth + 1, rng.choice(["break", "continue"]))

    def block(self, depth: int, *, inside: bool) -> None:
        for _ in range(self.rng.randint(1, 3)):
            self.statement(depth, inside=inside)
        self.put(depth, "z = z * 0.5")

    def index(self) -> str:
        return self.rng.choice([str(self.rng.randrange(ENTRIES)), f"({self.bounded()}) % {ENTRIES}"])

    def bounded(self) -> str:
        """Write a whole number that stays small whatever it is made of."""
        return f"({self.whole(2)}) % {self.rng.choice([7, 11, 97])}"

    def whole(self, depth: int) -> str:
        rng = self.rng
        if depth <= 0 or rng.random() < 0.25:
            return rng.choice([*WHOLES, str(rng.randint(-9, 9))])
        one, other, test = self.whole(depth - 1), self.whole(depth - 1), self.test(depth - 1)
        return rng.choice([
            f"({one} + {other})", f"({one} - {other})", f"({one} * {other})", f"({one} // 3)", f"({one} % -5)",
            f"abs({one})", f"(-{one})", f"min({one}, {other})", f"max({one}, 2)", f"({one} if {test} else {other})",
            f"int(min(max({self.number(depth - 1)}, -1e6), 1e6))",
        ])  # fmt: skip

    def number(self, depth: int) -> str:
        rng = self.rng
        if depth <= 0 or rng.random() < 0.2:
            return rng.choice([*FLOATS, f"A[{rng.randrange(ENTRIES)}]", repr(round(rng.uniform(-3, 3), 3)), "-0.0"])
        one, other, whole = self.number(depth - 1), self.number(depth - 1), self.whole(depth - 1)
        return rng.choice([
            f"({one} + {other})", f"({one} - {other})", f"({one} * {other})", f"({one} / (abs({other}) + 0.5))",
            f"({one} + {whole})", f"({whole} * {one})", f"({one} % 2.5)", f"({one} // 0.75)",
            f"abs({one})", f"(-{one})", f"min({one}, {other})", f"max({one}, {other}, 0.0)", f"float({whole})",
            f"({one} if {self.test(depth - 1)} else {other})", f"math.sqrt(abs({one}))", f"math.sin({one})",
            f"math.copysign({one}, {other})", f"({one} ** 2)", f"float(math.floor(min(max({one}, -1e6), 1e6)))",
            f"({one} and {other})", f"({one} or {other})",
        ])  # fmt: skip

    def test(self, depth: int) -> str:
        rng = self.rng
        if depth <= 0 or rng.random() < 0.5:
            one, other = self.number(0), self.number(0)
            return rng.choice([
                f"{one} < {other}", f"{self.whole(0)} >= {self.whole(0)}", f"{one} <= {other} < 2.0",
                f"{self.whole(0)} % 2 == 0", f"{one} != {other}",
            ])  # fmt: skip
        one, other = self.test(depth - 1), self.test(depth - 1)
        return rng.choice([f"({one} and {other})", f"({one} or {other})", f"not ({one})"])


def random_module(seed: int, functions: int) -> str:
    """Write a module of random functions, and an entry that calls each on entries of its own."""
    writer = Writer(seed)
    for _ in range(functions):
        writer.function()
    writer.lines += ["", "", "def entry(A, B, R) -> None:"]
    for k in range(functions):
        x, y, i, j = (f"B[{4 * k + m}]" for m in range(4))
        writer.lines.append(f"    R[{2 * k}], R[{2 * k + 1}] = f{k}(A, {x}, {y}, int({i}), int({j}))")
    return "\n".join(writer.lines) + "\n"
