"""Random programs in the language of kernels that branch, loop and leave wherever they can."""

from __future__ import annotations

import random

SIZE = 24  # entries of the buffer
FLOATS, INTS = ("x", "y", "z"), ("i", "j")


class Writer:
    """Writes one program `run(A, n)` on a buffer A of SIZE entries, with two functions that it calls."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.loops = 0
        self.functions: list[str] = []

    def program(self) -> str:
        texts = ["import math", "inf, nan = math.inf, math.nan"]
        for name in ("f", "g"):
            self.loops = 0
            body = self.block(3, returns=True)
            start = ["y = a * 0.5", "z = 1.0", "j = i + 1", "x = a"]
            lines = [*start, *body, f"return {self.number(1)}, {self.whole(1)}"]
            texts.append("\n".join([f"def {name}(A, a, i, n):", *(f"    {line}" for line in lines)]))
            self.functions.append(name)
        start = ["x = A[0]", "y = A[1] * 0.5", "z = -0.0", "i = n", "j = 0"]
        lines = [*start, *self.block(4, returns=False), *self.block(3, returns=False)]
        ends = [f"A[{k}] = {name}" for k, name in enumerate((*FLOATS, *INTS))]
        texts.append("\n".join(["def run(A, n):", *(f"    {line}" for line in [*lines, *ends])]))
        return "\n\n".join(texts) + "\n"

    # Statements ---------------------------------------------------------------------------------------------------

    def block(self, depth: int, *, returns: bool) -> list[str]:
        return [line for _ in range(self.random.randint(1, 3)) for line in self.statement(depth, returns=returns)]

    def statement(self, depth: int, *, returns: bool) -> list[str]:
        kinds = ["number", "number", "whole", "entry", "more", "tuple"]
        kinds += ["if", "if", "if", "while", "for", "for"] * (depth > 0) + ["call", "call"] * bool(self.functions)
        kinds += ["leave", "leave"] * (self.loops > 0) + ["return"] * returns
        r = self.random
        match r.choice(kinds):
            case "number":
                return [f"{r.choice(FLOATS)} = {self.number(3)}"]
            case "whole":
                return [f"{r.choice(INTS)} = {self.whole(2)}"]
            case "entry":
                return [f"A[{self.index()}] = {self.number(2)}"]
            case "more":
                return [r.choice([f"{r.choice(FLOATS)} += {self.number(1)}", f"A[{self.index()}] *= {self.number(1)}"])]
            case "tuple":
                return [f"x, y = {self.number(1)}, {self.number(2)}"]
            case "call":
                target = f"{r.choice(FLOATS)}, {r.choice(INTS)}"
                return [f"{target} = {r.choice(self.functions)}(A, {self.number(1)}, {self.whole(1)}, n)"]
            case "if":
                lines = [f"if {self.test(2)}:", *indented(self.block(depth - 1, returns=returns))]
                return (
                    [*lines, "else:", *indented(self.block(depth - 1, returns=returns))] if r.random() < 0.5 else lines
                )
            case "while":
                count = f"w{depth}"
                self.loops += 1
                body = [f"{count} += 1", *self.block(depth - 1, returns=returns)]
                self.loops -= 1
                return [f"{count} = 0", f"while {count} < {r.randint(2, 5)} and {self.test(1)}:", *indented(body)]
            case "for":
                self.loops += 1
                body = self.block(depth - 1, returns=returns)
                self.loops -= 1
                ends = ["3", "n", f"abs({self.whole(1)}) % 4", "1, 4", "4, 0, -1", f"int(A[{self.index()}] > 0.5) + 2"]
                return [f"for {r.choice(('k', *INTS))} in range({r.choice(ends)}):", *indented(body)]
            case "leave":
                leave = r.choice(["break", "continue"])
                return [f"if {self.test(1)}:", *indented([*self.statement(0, returns=False), leave])]
        return [f"if {self.test(1)}:", f"    return {self.number(1)}, {self.whole(1)}"]

    # Expressions --------------------------------------------------------------------------------------------------

    def number(self, depth: int) -> str:
        r = self.random
        if depth == 0:
            return r.choice([*FLOATS, *FLOATS, f"A[{self.index()}]", "0.5", "-1.25", "0.0", "n", r.choice(INTS)])
        a, b = self.number(depth - 1), self.number(depth - 1)
        return r.choice([
            f"({a} + {b})", f"({a} - {b})", f"({a} * {b})", f"abs({a})", f"-{a}" if a[0] != "-" else a,
            f"min({a}, {b})", f"float({self.whole(depth - 1)})",
            f"max({a}, {b}, 0.25)", f"({a} if {self.test(depth - 1)} else {b})", f"math.sqrt(abs({a}))",
            f"math.sin({a})" if depth < 2 else a, f"({a} / {b} if {b} != 0.0 else {a})",
            f"math.copysign({a}, {b} if {b} == {b} else 1.0)",
        ])  # fmt: skip

    def whole(self, depth: int) -> str:
        r = self.random
        if depth == 0:
            return r.choice([*INTS, "n", "1", "3", "0"])
        a, b = self.whole(depth - 1), self.whole(depth - 1)
        bounded = f"min(max({self.number(0)}, -9.0), 9.0)"
        return r.choice([
            f"({a} + {b}) % 64", f"({a} - {b})", f"{a} // 3", f"abs({a})", f"min({a}, {b})",
            f"int({bounded})", f"({a} if {self.test(depth - 1)} else {b})", f"({a} * 2) % 7",
        ])  # fmt: skip

    def test(self, depth: int) -> str:
        r = self.random
        if depth == 0:
            op = r.choice(["<", "<=", ">", ">=", "==", "!="])
            return r.choice([f"{self.number(0)} {op} {self.number(0)}", f"{self.whole(0)} {op} {self.whole(0)}"])
        a, b = self.test(depth - 1), self.test(depth - 1)
        read = f"A[{self.index()}] > {self.number(0)}"
        return r.choice([a, f"({a} and {b})", f"({a} or {b})", f"not ({a})", f"({a} and {read})", f"({a} or {read})",
                         f"-0.5 < {self.number(0)} < {self.number(1)}"])  # fmt: skip

    def index(self) -> str:
        r = self.random
        return r.choice(
            [str(r.randrange(SIZE)), str(r.randrange(SIZE)), f"({r.choice(INTS)} + {r.randint(0, 9)}) % {SIZE}"]
        )


def indented(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]
