"""The program of a straight line for many lanes: blocks of them one after another, measured as they run."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.straight import bounds
from graspfx.compile.straight.straight import Body, Text, Turns, reduced
from graspfx.compile.straight.trace import Guard, Node, Slot, Traceable, definitions, needed

FloatArray = NDArray[np.float64]

LANES = 32  # side by side: what they carry on fits the nearest cache
FIRST, LAST, SUM, SQUARES, LOW, HIGH, LATE_LOW, LATE_HIGH = range(8)  # of a column; LATE_: of the second half
MEASURES = 8
NEEDS = {  # what a statistic is made from
    "first": (FIRST,),
    "last": (LAST,),
    "mean": (SUM,),
    "rms": (SQUARES,),
    "min": (LOW, LATE_LOW),
    "max": (HIGH, LATE_HIGH),
    "peak": (LOW, HIGH, LATE_LOW, LATE_HIGH),
    "growth": (LOW, HIGH, LATE_LOW, LATE_HIGH),
}


@dataclass(frozen=True)
class LanesText:
    """A program `run(I, X, O, blocks, early, late)` for `early` turns in the first half and `late` in the second.

    Attributes:
        source: the program.
        inputs: entries of the buffers that each lane brings, in I at (block, input, lane).
        outputs: numbers that each lane gives, in O at (block, output, lane): MEASURES for each column, then whether
            the lane is not as it was taken for granted.
        scratch: entries of X.
        head: turns that are written out; `early` must be as many at least.
    """

    source: str
    inputs: tuple[Slot, ...]
    outputs: int
    scratch: int
    head: int


def lanes_text(program: Traceable, turns: Turns, columns: int, statistics: Collection[str]) -> LanesText:
    """Write the program of some turns that have been written down."""
    return _Lanes(program, turns, columns, {m for name in statistics for m in NEEDS[name]}).text()


class _Lanes:
    def __init__(self, program: Traceable, turns: Turns, columns: int, measured: Collection[int]) -> None:
        self.program, self.turns, self.columns, self.measured = program, turns, columns, sorted(measured)
        self.body: Body = reduced(turns)
        self.carried: list[Slot] = sorted(self.body.ends)
        self.measured = [m for m in self.measured if m < LATE_LOW]
        self.measures = [(c, m) for c in range(columns) for m in self.measured]
        self.bad = len(self.carried) + len(self.body.steady) + len(self.measures)
        self.slot = {slot: k for k, slot in enumerate(self.carried)}
        start = len(self.carried)
        self.steady = {node.number: start + k for k, node in enumerate(self.body.steady)}
        start += len(self.body.steady)
        self.place = {measure: start + k for k, measure in enumerate(self.measures)}

    def text(self) -> LanesText:
        head, inputs = self._head()
        single, unrolled = self._loop("single", 1), self._loop("several", self.body.turns)
        outputs = self.columns * MEASURES + 1
        entry = [
            "def run(I, X, O, blocks, early, late):",
            "    for b in range(blocks):",
            f"        i = b * {len(inputs) * LANES}",
            f"        o = b * {outputs * LANES}",
            *_indented(2, [f"for lane in range({LANES}):", *_indented(1, head)]),
            *_indented(2, self._half("early - " + str(len(self.turns.watched)), str(len(self.turns.watched)))),
            *_indented(2, self._store_measures((LOW, HIGH), outputs)),
            *_indented(2, self._half("late", "early")),
            *_indented(2, self._store_measures((FIRST, LAST, SUM, SQUARES), outputs)),
            *_indented(2, self._store_measures((LOW, HIGH), outputs, late=True)),
            *_indented(2, [f"for lane in range({LANES}):"]),
            f"            O[o + {(outputs - 1) * LANES} + lane] = X[{self.bad * LANES} + lane]",
        ]
        calls = {n.args[0] for g in (self.turns.head, self.turns.body) for n in g.nodes if n.op == "call"}
        parts = ["import math", "inf, nan = math.inf, math.nan", *definitions(self.program.tree, calls)]
        source = "\n\n".join([*parts, single, unrolled, "\n".join(entry)]) + "\n"
        return LanesText(source, inputs, outputs, (self.bad + 1) * LANES, len(self.turns.watched))

    # The first turns ----------------------------------------------------------------------------------------------

    def _head(self) -> tuple[list[str], tuple[Slot, ...]]:
        turns, body = self.turns, self.body
        inputs = [n for n in turns.head.nodes if n.op == "input"]
        once = [n for n in turns.body.nodes if n.op == "input" and n.steady]
        first = {slot: turns.begin(slot) for slot in self.carried}
        begins = {n.args[0]: turns.begin(n.args[0]) for n in once}
        inputs = [n for n in turns.head.nodes if n.op == "input"]  # `begin` may have asked for more
        text = Text("h", {n.number: f"x{k}" for k, n in enumerate(inputs)})
        lines = [f"x{k} = I[i + {k * LANES} + lane]" for k in range(len(inputs))]
        lines.append("bad = 0.0")
        guards = list(turns.head.guards.values())
        text.compute([*(v for g in guards for v in (g.a, g.b)), *first.values(), *begins.values()])
        text.compute(v for row in turns.watched for v in row)
        text.lines += [_noted(text, guard) for guard in guards]
        for c in range(self.columns):
            for k, row in enumerate(turns.watched):
                text.lines += _measured(self.measured, c, text.text_of(row[c]), begin=k == 0)
        after = Text("s", self._steady_names(text, begins))
        after.compute([v for g in body.once for v in (g.a, g.b)])
        after.compute([*body.bounded, *body.divisors, *body.steady])
        after.lines += [_noted(after, guard) for guard in body.once]
        after.lines += [
            _noted(after, Guard("<=", f"abs({after.text_of(n)})", bounds.STEADY, True)) for n in body.bounded
        ]
        after.lines += [
            _noted(after, Guard(">=", f"abs({after.text_of(n)})", 1.0 / bounds.STEADY, True)) for n in body.divisors
        ]
        stores = [f"X[{self.slot[slot] * LANES} + lane] = {text.text_of(value)}" for slot, value in first.items()]
        stores += [f"X[{self.steady[n.number] * LANES} + lane] = {after.text_of(n)}" for n in body.steady]
        stores += [f"X[{self.place[c, m] * LANES} + lane] = {_measure(c, m)}" for c, m in self.measures]
        stores.append(f"X[{self.bad * LANES} + lane] = bad")
        return [*lines, *text.lines, *after.lines, *stores], tuple(n.args[0] for n in inputs)

    def _steady_names(self, text: Text, begins: Mapping[Slot, Any]) -> dict[int, str]:
        """Name the body's steady inputs, for the graph without omitted parts."""
        names: dict[int, str] = {}
        body = self.body
        left = [*body.bounded, *body.divisors, *body.steady]
        left += [v for g in body.once for v in (g.a, g.b) if isinstance(v, Node)]
        while left:
            node = left.pop()
            if node.op == "input":
                names[node.number] = text.text_of(begins[node.args[0]])
            else:
                left += [arg for arg in node.args if isinstance(arg, Node)]
        return names

    # Later turns --------------------------------------------------------------------------------------------------

    def _loop(self, name: str, count: int) -> str:
        body = self.body
        lines = [f"s{k} = X[{k * LANES} + lane]" for k in range(len(self.carried))]
        lines += [f"p{k} = X[{place * LANES} + lane]" for k, place in self.steady.items()]
        lines += [f"{_measure(c, m)} = X[{self.place[c, m] * LANES} + lane]" for c, m in self.measures]
        lines.append(f"bad = X[{self.bad * LANES} + lane]")
        blank = Text("", {})
        lines += [_noted(blank, Guard("<=", f"abs(s{k})", bounds.CARRIED, True)) for k in range(len(self.carried))]
        texts = {slot: f"s{k}" for k, slot in enumerate(self.carried)}
        steady = {number: f"p{number}" for number in self.steady}
        roots = [*body.output, *body.ends.values(), *(v for g in body.guards for v in (g.a, g.b))]
        for turn in range(count):
            names = dict(steady)
            for node in _inputs(roots):
                names[node.number] = texts[node.args[0]] if node.op == "input" else f"(k + {turn})"
            text = Text(f"t{turn}_", names)
            text.compute(roots)
            text.lines += [_noted(text, guard) for guard in body.guards]
            for c in range(self.columns):
                text.lines += _measured(self.measured, c, text.text_of(body.output[c]), begin=False)
            lines += text.lines
            texts = {slot: text.text_of(body.ends[slot]) for slot in self.carried}
        lines += [f"X[{self.slot[slot] * LANES} + lane] = {value}" for slot, value in texts.items()]
        lines += [f"X[{self.place[c, m] * LANES} + lane] = {_measure(c, m)}" for c, m in self.measures]
        lines.append(f"X[{self.bad * LANES} + lane] = bad")
        return "\n".join(
            [
                f"def {name}(X, begin, turns):",
                "    k = begin",
                "    for turn in range(turns):",
                f"        for lane in range({LANES}):",
                *_indented(3, lines),
                f"        k = k + {count}",
            ]
        )

    def _half(self, turns: str, begin: str) -> list[str]:
        count = self.body.turns
        return [
            f"left = {turns}",
            f"several(X, {begin}, left // {count})",
            f"single(X, {begin} + {count} * (left // {count}), left % {count})",
        ]

    def _store_measures(self, columns: Sequence[int], outputs: int, *, late: bool = False) -> list[str]:
        """Store measures where the lanes give them; the least and the largest then begin anew."""
        lines = []
        for c, m in self.measures:
            if m in columns:
                to = m + (LATE_LOW - LOW if late else 0)
                lines.append(f"O[o + {(c * MEASURES + to) * LANES} + lane] = X[{self.place[c, m] * LANES} + lane]")
                if m in (LOW, HIGH) and not late:
                    lines.append(f"X[{self.place[c, m] * LANES} + lane] = {'inf' if m == LOW else '-inf'}")
        return [f"for lane in range({LANES}):", *_indented(1, lines)] if lines else []


def _inputs(roots: Sequence[Any]) -> list[Node]:
    nodes = needed(n for n in roots if isinstance(n, Node) and not n.steady)
    return [n for n in nodes if (n.op == "input" and not n.steady) or n.op == "tick"]


def _noted(text: Text, guard: Guard) -> str:
    return f"bad = bad if {text.asks(guard)} else 1.0"


def _measure(c: int, m: int) -> str:
    return f"m{c}_{m}"


def _measured(measured: Sequence[int], c: int, x: str, *, begin: bool) -> list[str]:
    """Write lines that take one number of a column into its measures."""
    lines = []
    for m in measured:
        name = _measure(c, m)
        if begin:
            lines.append(f"{name} = {'0.0' if m in (SUM, SQUARES) else x}")
        if m == LAST:
            lines.append(f"{name} = {x}")
        elif m == SUM:
            lines.append(f"{name} = {name} + {x}")
        elif m == SQUARES:
            lines.append(f"{name} = {name} + {x} * {x}")
        elif m == LOW:
            lines.append(f"{name} = {x} if {x} < {name} else {name}")
        elif m == HIGH:
            lines.append(f"{name} = {x} if {x} > {name} else {name}")
    return lines


def _indented(depth: int, lines: Sequence[str]) -> list[str]:
    return [f"{'    ' * depth}{line}" for line in lines]
